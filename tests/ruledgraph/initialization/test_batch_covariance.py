# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest

from ruledgraph.initialization.batch_covariance import state_covariance

STATE, LINES, ROWS = 0, 1, 12
HALF = ROWS // 2


class Problem:
    """Lines that see a state of three numbers, truly zero, each through two numbers of its own.

    The noise has deviation one; what all rows of a line have in common acts like a state that is
    off by the deviation `common`.
    """

    def __init__(self, rng: np.random.Generator, lines: int = 15, common: float = 0.0) -> None:
        A = rng.normal(size=(lines, ROWS, 3))
        noise = rng.normal(size=(lines, ROWS)) + np.einsum(
            "lrs,ls->lr", A, rng.normal(scale=common, size=(lines, 3))
        )
        self.rows = np.zeros((lines * ROWS, 3 + 2 * lines))
        self.rows[:, :3] = A.reshape(-1, 3)
        for i in range(lines):
            self.rows[i * ROWS : (i + 1) * ROWS, 3 + 2 * i : 5 + 2 * i] = rng.normal(size=(ROWS, 2))
        # A weak prior on the state.
        self.prior = np.zeros((3, self.rows.shape[1]))
        self.prior[:, :3] = 0.1 * np.eye(3)
        everything = np.vstack([self.rows, self.prior])
        self.solution = np.linalg.lstsq(everything, np.append(noise.ravel(), np.zeros(3)))[0]
        self.covariance = np.linalg.inv(everything.T @ everything)[:3, :3]
        self.residual = noise.ravel() - self.rows @ self.solution

    def graph(self) -> gtsam.GaussianFactorGraph:
        """Linearised at the solution, each line in two factors."""
        graph = gtsam.GaussianFactorGraph()
        of_state = -self.prior[:, :3] @ self.solution[:3]
        unit = gtsam.noiseModel.Unit.Create
        graph.add(gtsam.JacobianFactor(STATE, self.prior[:, :3], of_state, unit(3)))
        for n in range(0, len(self.rows), HALF):
            i, rows = n // ROWS, slice(n, n + HALF)
            A, own = self.rows[rows, :3], self.rows[rows, 3 + 2 * i : 5 + 2 * i]
            b = self.residual[rows]
            graph.add(gtsam.JacobianFactor(STATE, A, LINES + i, own, b, unit(HALF)))
        return graph


def normalised_error(common: float) -> float:
    """Mean of the normalised squared error by degree of freedom, over 400 problems."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(400):
        problem = Problem(rng, common=common)
        covariance = state_covariance(problem.graph(), [STATE], 0)
        off = problem.solution[:3]
        errors.append(off @ np.linalg.solve(covariance, off))
    return float(np.mean(errors)) / 3.0


def test_lines_that_disagree_widen_the_covariance_as_much_as_the_error():
    # By the noise model alone it would be 1 + 12 * common^2 and more; a covariance found from 15
    # lines makes the mean of a quotient larger by about 3/12, the deviation over 400 draws is 0.05.
    assert 0.85 < normalised_error(common=1.0) < 1.5


def test_without_disagreement_the_noise_counts_twice():
    # Once by the noise model, once by the scatter of the lines.
    assert 0.45 < normalised_error(common=0.0) < 0.65


def test_it_is_the_noise_models_covariance_where_every_line_fits_exactly():
    problem = Problem(np.random.default_rng(1))
    problem.residual[:] = 0.0
    covariance = state_covariance(problem.graph(), [STATE], 0)
    np.testing.assert_allclose(covariance, problem.covariance, rtol=1e-9)


def test_variables_that_count_as_known_are_not_in_it():
    problem = Problem(np.random.default_rng(2))
    problem.residual[:] = 0.0
    known = state_covariance(problem.graph(), [STATE], 1)
    information = np.linalg.inv(problem.covariance)[:2, :2]
    np.testing.assert_allclose(known, np.linalg.inv(information), rtol=1e-9)


def test_a_state_that_nothing_fixes_is_an_error():
    graph = gtsam.GaussianFactorGraph()
    A, unit = np.diag([1.0, 1.0, 0.0]), gtsam.noiseModel.Unit.Create(3)
    graph.add(gtsam.JacobianFactor(STATE, A, np.zeros(3), unit))
    with pytest.raises((RuntimeError, np.linalg.LinAlgError)):
        state_covariance(graph, [STATE], 0)
