# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The prior on a line's distance."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L

from ruledgraph_factors import FactorError, LineChart, line_distance_prior

UNIT = noiseModel.Unit.Create(1)


def a_chart(distance: float) -> LineChart:
    """A vertical line in front of a camera at the origin."""
    normal = np.array([1.0, 0.0, 0.0])
    return LineChart.from_ruling(gtsam.Pose3(), normal, 1.0 / distance, np.array([0.0, 0.0]))


def at(chart: LineChart, phi: float) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(L(0), np.array([phi - chart.angle, 0.3, -0.2, 0.1]))
    return values


@pytest.mark.parametrize("distance", [0.2, 1.0, 3.0, 50.0])
def test_it_is_the_logarithm_of_the_distance_over_the_median(distance: float) -> None:
    chart = a_chart(distance)
    factor = line_distance_prior(UNIT, L(0), chart, 3.0)
    residual = factor.unwhitenedError(at(chart, chart.angle))
    assert residual == pytest.approx([np.log(3.0 / distance)], abs=1e-12)


@pytest.mark.parametrize("phi", [-1.0, -0.1, 0.0, 0.005, 0.02, 0.5, 1.5, 1.565, 1.6, 3.0])
def test_its_jacobian_is_the_numerical_derivative_for_every_line(phi: float) -> None:
    chart = a_chart(2.0)
    factor = line_distance_prior(UNIT, L(0), chart, 3.0)
    jacobian = factor.linearize(at(chart, phi)).jacobian()[0]
    step = 1e-6
    after, before = (factor.unwhitenedError(at(chart, phi + d))[0] for d in (step, -step))
    # The second derivative is at most 1e4, the step's error 1e-8 of it.
    assert jacobian[0, 0] == pytest.approx((after - before) / (2.0 * step), rel=1e-4)
    assert np.all(jacobian[0, 1:] == 0.0)


def test_infinity_costs_more_than_any_line_in_front() -> None:
    factor = line_distance_prior(UNIT, L(0), a_chart(2.0), 3.0)
    costs = [factor.error(at(a_chart(2.0), phi)) for phi in (0.3, 0.1, 0.01, 0.0, -0.01)]
    assert costs == sorted(costs)


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
        line_distance_prior(noise, L(0), a_chart(1.0), distance)
