# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The factor that says how far away a line is about."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, X

from numerics import factor_jacobians, numerical_jacobian, relative_error
from ruledgraph_factors import FactorError, LineChart, line_distance_factor

UNIT = noiseModel.Unit.Create(1)
HERE = gtsam.Pose3()
ELSEWHERE = gtsam.Pose3(gtsam.Rot3.Ypr(0.3, -0.2, 0.4), np.array([0.3, -0.4, 0.5]))


def a_chart(distance: float) -> LineChart:
    """A vertical line in front of a camera at the origin."""
    normal = np.array([1.0, 0.0, 0.0])
    return LineChart.from_ruling(HERE, normal, 1.0 / distance, np.array([0.0, 0.0]))


def at(chart: LineChart, phi: float, pose: gtsam.Pose3 = HERE) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(X(0), pose)
    values.insert(L(0), np.array([phi - chart.angle, 0.3, -0.2, 0.1]))
    return values


@pytest.mark.parametrize("distance", [0.2, 1.0, 3.0, 15.0])
@pytest.mark.parametrize("pose", [HERE, ELSEWHERE])
def test_it_is_the_logarithm_of_the_distance_over_the_median(
    distance: float, pose: gtsam.Pose3
) -> None:
    chart = a_chart(distance)
    factor = line_distance_factor(UNIT, X(0), L(0), chart, 3.0)
    values = at(chart, chart.angle, pose)
    far, _, _ = chart.distance_to(values.atVector(L(0)), pose.translation())
    residual = factor.unwhitenedError(values)
    assert residual == pytest.approx([np.log(3.0 / far)], abs=1e-9)


@pytest.mark.parametrize("phi", [-1.0, -0.1, 0.0, 0.005, 0.02, 0.5, 1.5, 1.565, 1.7])
def test_its_jacobians_are_the_numerical_derivatives_for_every_line(phi: float) -> None:
    chart = a_chart(2.0)
    factor = line_distance_factor(UNIT, X(0), L(0), chart, 3.0)
    values = at(chart, phi, ELSEWHERE)
    for key, jacobian in factor_jacobians(factor, values).items():
        assert relative_error(jacobian, numerical_jacobian(factor, values, key, 1e-6)) < 1e-5


def test_infinity_costs_more_than_any_line_in_front() -> None:
    factor = line_distance_factor(UNIT, X(0), L(0), a_chart(2.0), 3.0)
    costs = [factor.error(at(a_chart(2.0), phi)) for phi in (0.3, 0.1, 0.01, 0.0, -0.01)]
    assert costs == sorted(costs)


def test_it_says_nothing_of_where_pose_and_line_are_together() -> None:
    chart = a_chart(2.0)
    factor = line_distance_factor(UNIT, X(0), L(0), chart, 3.0)
    values = at(chart, chart.angle)
    ends, _ = chart.end_points(values.atVector(L(0)), [-1.0, 1.0])
    moved = [ELSEWHERE.transformFrom(end) for end in ends]
    there = gtsam.Values()
    there.insert(X(0), ELSEWHERE * HERE)
    direction = moved[1] - moved[0]
    there.insert(L(0), chart.local(np.cross(moved[0], direction), direction))
    assert factor.error(there) == pytest.approx(factor.error(values), rel=1e-9)


@pytest.mark.parametrize("kernel", ["numpy", "native"])
def test_nan_in_the_line_is_an_error_of_nan(kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RULEDGRAPH_KERNEL", kernel)
    factor = line_distance_factor(UNIT, X(0), L(0), a_chart(2.0), 3.0)
    values = at(a_chart(2.0), np.nan)
    assert np.isnan(factor.error(values))
    assert all(np.isnan(block).any() for block in factor_jacobians(factor, values).values())


@pytest.mark.parametrize(
    ("noise", "distance", "said"),
    [
        (noiseModel.Unit.Create(4), 3.0, "dimension 4"),
        (UNIT, -1.0, "distance must be positive"),
        (UNIT, np.nan, "distance has a NaN"),
    ],
)
def test_bad_arguments_are_named(noise: noiseModel.Base, distance: float, said: str) -> None:
    with pytest.raises(FactorError, match=said):
        line_distance_factor(noise, X(0), L(0), a_chart(1.0), distance)
