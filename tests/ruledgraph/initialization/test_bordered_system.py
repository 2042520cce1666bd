# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.initialization.bordered_system import BorderedSystem

STATE, OWN, ROWS = 3, 4, 12


class Problem:
    """Lines that see a state of three numbers, truly zero, each through four numbers of its own.

    The noise has deviation one; what all rows of a line have in common acts like a state that is
    off by the deviation `common`.
    """

    def __init__(self, rng: np.random.Generator, lines: int = 15, common: float = 0.0) -> None:
        self.blocks = rng.normal(size=(lines, ROWS, STATE + OWN))
        off = rng.normal(scale=common, size=(lines, STATE))
        noise = rng.normal(size=(lines, ROWS))
        noise += np.einsum("lrs,ls->lr", self.blocks[:, :, :STATE], off)
        # A weak prior on the state.
        self.prior = 0.01 * np.eye(STATE)
        self.rows = np.zeros((lines * ROWS, STATE + OWN * lines))
        for i, block in enumerate(self.blocks):
            own = slice(STATE + OWN * i, STATE + OWN * (i + 1))
            rows = slice(ROWS * i, ROWS * (i + 1))
            self.rows[rows, :STATE], self.rows[rows, own] = block[:, :STATE], block[:, STATE:]
        self.information = self.rows.T @ self.rows
        self.information[:STATE, :STATE] += self.prior
        self.covariance = np.linalg.inv(self.information)[:STATE, :STATE]
        self.solution = np.linalg.solve(self.information, self.rows.T @ noise.ravel())
        self.residual = self.rows @ self.solution - noise.ravel()

    def system(self) -> BorderedSystem:
        """Linearised at the solution."""
        residuals = self.residual.reshape(len(self.blocks), ROWS)
        return BorderedSystem(
            self.prior,
            self.prior @ self.solution[:STATE],
            np.einsum("lri,lrj->lij", self.blocks, self.blocks),
            np.einsum("lri,lr->li", self.blocks, residuals),
        )


def normalised_error(common: float) -> float:
    """Mean of the normalised squared error by degree of freedom, over 400 problems."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(400):
        problem = Problem(rng, common=common)
        off = problem.solution[:STATE]
        errors.append(off @ np.linalg.solve(problem.system().state_covariance(), off))
    return float(np.mean(errors)) / STATE


def test_lines_that_disagree_widen_the_covariance_as_much_as_the_error():
    # By the noise model alone it would be 1 + 8 * common^2 and more; a covariance found from 15
    # lines makes the mean of a quotient larger by about 3/12, the deviation over 400 draws is 0.05.
    assert 0.85 < normalised_error(common=1.0) < 1.5


def test_without_disagreement_the_noise_counts_twice():
    # Once by the noise model, once by the scatter of the lines.
    assert 0.45 < normalised_error(common=0.0) < 0.65


def test_it_is_the_noise_models_covariance_where_every_line_fits_exactly():
    problem = Problem(np.random.default_rng(1))
    problem.residual[:] = 0.0
    np.testing.assert_allclose(
        problem.system()._replace(gradient=np.zeros(STATE)).state_covariance(),
        problem.covariance,
        rtol=1e-9,
    )


def test_variables_that_count_as_known_are_not_in_it():
    problem = Problem(np.random.default_rng(2))
    problem.residual[:] = 0.0
    known = problem.system().state_covariance(fixed=1)
    information = np.linalg.inv(problem.covariance)[:2, :2]
    np.testing.assert_allclose(known, np.linalg.inv(information), rtol=1e-9)


def test_a_lines_covariance_is_that_with_the_state_known():
    problem = Problem(np.random.default_rng(5))
    for i, covariance in enumerate(problem.system().line_covariances()):
        own = slice(STATE + OWN * i, STATE + OWN * (i + 1))
        np.testing.assert_allclose(
            covariance, np.linalg.inv(problem.information[own, own]), rtol=1e-9
        )


def test_a_state_that_nothing_fixes_is_an_error():
    nothing = np.zeros((0, STATE + OWN, STATE + OWN)), np.zeros((0, STATE + OWN))
    system = BorderedSystem(np.diag([1.0, 1.0, 0.0]), np.zeros(STATE), *nothing)
    with pytest.raises(np.linalg.LinAlgError):
        system.state_covariance()


@pytest.mark.parametrize("damping", [0.0, 1e-3, 10.0])
def test_a_step_is_that_of_the_whole_system(damping):
    problem = Problem(np.random.default_rng(3))
    at = np.random.default_rng(4).normal(size=len(problem.solution))
    problem.residual += problem.rows @ at
    gradient = problem.rows.T @ problem.residual
    gradient[:STATE] += problem.prior @ (problem.solution + at)[:STATE]
    problem.solution = problem.solution + at
    damped = problem.information + damping * np.diag(np.diag(problem.information))
    wanted = -np.linalg.solve(damped, gradient)
    step = problem.system().step(damping)
    found = np.concatenate([step.state, step.lines.ravel()])
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
    gain = -(gradient @ wanted + 0.5 * wanted @ problem.information @ wanted)
    assert step.gain == pytest.approx(gain, rel=1e-9)
    if damping == 0.0:
        np.testing.assert_allclose(found, -at, rtol=1e-9, atol=1e-9)
