# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A whole window in GTSAM: convergence and consistency over 100 seeds, and the gauge."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, L, V, X
from scipy.stats import chi2

from numerics import dimension, read
from simulated_window import SEGMENTS, optimize, smoothing_problem

SEEDS = 100

# The runs are shared: all tests that look at them belong on one worker of pytest-xdist.
one_worker = pytest.mark.xdist_group("solved windows")


@pytest.fixture(scope="module")
def solved() -> list[dict[str, float]]:
    """Normalised estimation error squared (NEES) of every variable kind, for every seed.

    Half the seeds start with the lines twice too far, half with twice too near.
    """
    results = []
    for seed in range(SEEDS):
        problem = smoothing_problem(
            np.random.default_rng(seed), depth_factor=2.0 if seed % 2 == 0 else 0.5
        )
        values = optimize(problem)
        marginals = gtsam.Marginals(problem.graph, values)
        last = problem.nodes - 1
        keys = {"pose": X(last), "velocity": V(last), "pose in the middle": X(last // 2)}
        keys |= {"first bias": B(0), "bias": B(last)}
        keys |= {f"line {i}": L(i) for i in range(len(SEGMENTS))}
        result = {}
        for name, key in keys.items():
            estimate, truth = read(values, key), read(problem.truth, key)
            if isinstance(estimate, gtsam.Pose3):
                error = estimate.localCoordinates(truth)
            elif isinstance(estimate, gtsam.imuBias.ConstantBias):
                error = truth.vector() - estimate.vector()
            else:
                error = truth - estimate
            result[name] = float(error @ np.linalg.solve(marginals.marginalCovariance(key), error))
        offset = read(values, X(last)).translation() - read(problem.truth, X(last)).translation()
        result["position error"] = float(np.linalg.norm(offset))
        results.append(result)
    return results


@one_worker
def test_converges_from_a_depth_wrong_by_two_for_every_seed(solved) -> None:
    """A run that ends elsewhere is off by decimetres; the standard deviation here is 3 mm."""
    assert max(result["position error"] for result in solved) < 0.012
    for kind, degrees in (("pose", 6), ("velocity", 3), ("line 0", 4), ("line 3", 4)):
        assert max(r[kind] for r in solved) < chi2.ppf(1.0 - 1e-6, degrees)


@one_worker
@pytest.mark.parametrize(
    ("kind", "degrees"),
    [("pose", 6), ("velocity", 3), ("pose in the middle", 6)]
    + [(f"line {i}", 4) for i in range(len(SEGMENTS))],
)
def test_mean_nees_is_within_its_95_percent_bounds(solved, kind: str, degrees: int) -> None:
    total = sum(result[kind] for result in solved)
    low, high = chi2.ppf([0.025, 0.975], degrees * SEEDS)
    assert low < total < high, f"mean NEES {total / SEEDS:.2f} of {degrees} degrees of freedom"


@one_worker
@pytest.mark.parametrize("kind", ["first bias", "bias"])
def test_bias_is_overconfident_by_no_more_than_stated(solved, kind: str) -> None:
    """Noise of the IMU between a state and its frames is not in the factor: a fifth, not a half."""
    mean = sum(result[kind] for result in solved) / SEEDS
    assert 0.8 < mean / 6.0 < 1.35


def gauge_directions(values: gtsam.Values) -> np.ndarray:
    """Tangents of a common shift (three) and of a common turn about gravity, by differencing
    GTSAM's own localCoordinates; columns in the order of the keys."""
    step = 1e-6
    directions = []
    for i in range(4):
        turn = gtsam.Rot3.Rz(step if i == 3 else 0.0)
        moved = gtsam.Pose3(turn, step * np.eye(4)[i][:3])
        tangent = []
        for key in sorted(values.keys()):
            value = read(values, key)
            if isinstance(value, gtsam.Pose3):
                tangent.append(value.localCoordinates(moved * value) / step)
            elif isinstance(value, gtsam.imuBias.ConstantBias):
                tangent.append(np.zeros(6))
            elif len(value) == 3:
                tangent.append((turn.rotate(value) - value) / step)
            else:
                tangent.append(None)  # a line: what its factors need, solved for below
        directions.append(tangent)
    return directions


def test_lines_and_imu_keep_exactly_four_gauge_freedoms() -> None:
    """The null space of the linearised graph without priors: three translations and yaw."""
    problem = smoothing_problem(np.random.default_rng(5))
    graph = gtsam.NonlinearFactorGraph()
    for i in range(problem.graph.size()):
        factor = problem.graph.at(i)
        if isinstance(factor, gtsam.CombinedImuFactor | gtsam.CustomFactor):
            graph.add(factor)
    values = optimize(problem)
    keys = sorted(values.keys())
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    jacobian, _ = graph.linearize(values).jacobian(ordering)
    scale = np.linalg.norm(jacobian, axis=0)
    singular, null = np.linalg.svd(jacobian / scale)[1:]
    # Four that are zero to rounding, 1e-15; the weakest observable direction has 6e-4.
    assert singular[-4] < 1e-12 * singular[0]
    assert singular[-5] > 1e-5 * singular[0]
    null_space = null[-4:].T / scale[:, None]

    # The same space as the gauge: match its motion of poses, velocities and biases.
    starts = np.cumsum([0] + [dimension(read(values, key)) for key in keys])
    states = np.concatenate(
        [
            np.arange(starts[i], starts[i + 1])
            for i, key in enumerate(keys)
            if chr(gtsam.symbolChr(key)) != "l"
        ]
    )
    for tangent in gauge_directions(values):
        gauge = np.concatenate([part for part in tangent if part is not None])
        found, *_ = np.linalg.lstsq(null_space[states], gauge, rcond=None)
        residual = null_space[states] @ found - gauge
        assert np.linalg.norm(residual) < 1e-4 * np.linalg.norm(gauge)


def test_nodes_are_counted_as_the_names_say() -> None:
    problem = smoothing_problem(np.random.default_rng(0))
    assert problem.nodes == 16
    assert problem.truth.exists(B(15))
    assert problem.graph.size() == 3 + 4 + 16 * 4 + 15
