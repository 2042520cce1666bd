# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The prior on a new line that moves with the pose that saw it."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, X

from numerics import factor_jacobians, numerical_jacobian, relative_error
from random_factors import random_case
from ruledgraph_factors import NEW_LINE_SIGMAS, FactorError, LineChart, new_line_factor
from ruledgraph_factors.new_line import moved_with

UNIT = noiseModel.Diagonal.Sigmas(np.ones(4))
POSE = gtsam.Pose3(gtsam.Rot3.Ypr(0.3, -0.2, 0.4), np.array([0.3, -0.4, 0.5]))
CHART = LineChart.from_points(POSE, [2.0, 1.0, -0.5], [2.5, 0.0, 1.0])


def carried(chart: LineChart, by: gtsam.Pose3) -> np.ndarray:
    """delta of the reference line after a motion of the world."""
    moment, direction = np.split(chart.plucker(np.zeros(4))[0], 2)
    direction = by.rotation().rotate(direction)
    return chart.local(
        by.rotation().rotate(moment) + np.cross(by.translation(), direction), direction
    )


def at(pose: gtsam.Pose3, delta: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(X(0), pose)
    values.insert(L(0), delta)
    return values


def test_lines_move_with_the_pose() -> None:
    for seed in range(20):
        case, step = random_case(seed), 1e-6
        chart, pose = case.chart, case.values.atPose3(X(0))
        numerical = [
            (
                carried(chart, pose.retract(row) * pose.inverse())
                - carried(chart, pose.retract(-row) * pose.inverse())
            )
            / (2.0 * step)
            for row in step * np.eye(6)
        ]
        ours = moved_with(chart, pose)
        scale = max(1.0, float(np.abs(ours).max()))
        np.testing.assert_allclose(ours, np.transpose(numerical), atol=1e-7 * scale)


@pytest.mark.parametrize("turn", [0.0, 0.01, 0.1, 0.3])
def test_its_jacobian_by_the_pose_lacks_the_derivative_of_the_logarithm(turn: float) -> None:
    """As its docstring says: exact where it was made, off by up to half the turn elsewhere."""
    for seed in range(20):
        case = random_case(seed)
        pose = case.values.atPose3(X(0))
        axis = case.rng.normal(size=3)
        xi = np.append(turn * axis / np.linalg.norm(axis), np.zeros(3))
        factor = new_line_factor(UNIT, X(0), L(0), case.chart, pose)
        values = at(pose.retract(xi), np.zeros(4))
        ours = factor_jacobians(factor, values)[X(0)]
        right = numerical_jacobian(factor, values, X(0), 1e-6)
        np.testing.assert_array_equal(ours, -moved_with(case.chart, pose))
        np.testing.assert_allclose(
            ours @ gtsam.Pose3.LogmapDerivative(gtsam.Pose3.Expmap(xi)), right, atol=1e-6
        )
        share = np.linalg.norm(ours - right, 2) / np.linalg.norm(right, 2)
        assert share <= 0.5 * turn + 1e-6
        assert share > 0.4 * turn - 1e-6


def test_it_is_a_prior_on_the_chart_as_long_as_the_pose_stays() -> None:
    delta = np.array([0.2, -0.4, 0.1, 0.3])
    noise = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
    factor = new_line_factor(noise, X(0), L(0), CHART, POSE)
    prior = gtsam.PriorFactorVector(L(0), np.zeros(4), noise)
    values = at(POSE, delta)
    assert factor.error(values) == pytest.approx(prior.error(values), rel=1e-12)


def test_it_says_nothing_of_where_pose_and_line_are_together() -> None:
    factor = new_line_factor(UNIT, X(0), L(0), CHART, POSE)
    alone = []
    for motion in 1e-3 * np.vstack([np.eye(6), -np.eye(6)]):
        by = gtsam.Pose3.Expmap(motion)
        moved = at(by * POSE, carried(CHART, by))
        # What remains is of second order.
        assert 2.0 * factor.error(moved) < 1e-10
        alone.append(2.0 * factor.error(at(POSE, carried(CHART, by))))
    # Of the line without the pose it says what a prior on the chart says.
    assert 1e-7 < max(alone) < 1e-4


def test_a_line_that_has_wrapped_costs_what_its_smallest_delta_costs() -> None:
    factor = new_line_factor(UNIT, X(0), L(0), CHART, POSE)
    delta = np.array([0.2, -0.4, 0.1, 0.3])
    turn = delta[1:] * (1.0 - 2.0 * np.pi / np.linalg.norm(delta[1:]))
    cost = factor.error(at(POSE, delta))
    for same in (np.append(delta[0] + 4.0 * np.pi, delta[1:]), np.append(delta[0], turn)):
        assert factor.error(at(POSE, same)) == pytest.approx(cost, rel=1e-9)
    values = at(POSE, np.append(delta[0] + np.pi, turn))
    ours = factor_jacobians(factor, values)[L(0)]
    numeric = numerical_jacobian(factor, values, L(0), 1e-6)
    assert relative_error(ours, numeric) < 1e-6


def test_nan_in_the_line_is_an_error_of_nan() -> None:
    factor = new_line_factor(UNIT, X(0), L(0), CHART, POSE)
    assert np.isnan(factor.error(at(POSE, np.array([np.nan, 0.0, 0.0, 0.0]))))


def test_it_takes_robust_noise() -> None:
    huber = noiseModel.Robust.Create(noiseModel.mEstimator.Huber.Create(1.0), UNIT)
    factor = new_line_factor(huber, X(0), L(0), CHART, POSE)
    # Beyond 1 Huber's loss grows as its argument less a half.
    assert factor.error(at(POSE, np.array([0.0, 1.4, 0.0, 0.0]))) == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("noise", "chart", "pose", "said"),
    [
        (noiseModel.Diagonal.Sigmas(np.ones(2)), CHART, POSE, "dimension 2"),
        (UNIT, CHART, np.eye(4), "world_T_body must be a"),
        (UNIT, LineChart(POSE, np.eye(3), np.pi / 2), POSE, "runs through its anchor"),
    ],
)
def test_bad_arguments_are_named(noise, chart, pose, said) -> None:
    with pytest.raises(FactorError, match=said):
        new_line_factor(noise, X(0), L(0), chart, pose)
