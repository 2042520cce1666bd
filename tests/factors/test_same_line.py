# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L

from numerics import derivative
from ruledgraph_factors import FactorError, LineChart, same_line_factor


def random_pose(rng: np.random.Generator) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(scale=0.5, size=3)), rng.normal(size=3))


def random_pair(rng: np.random.Generator) -> tuple[LineChart, np.ndarray, LineChart]:
    """A chart, a line some way from its reference, and a new chart at that line."""
    chart = LineChart.from_points(random_pose(rng), *rng.normal([0.0, 0.0, 4.0], size=(2, 3)))
    delta = rng.normal(scale=0.3, size=4)
    new_chart, _ = chart.reanchor(delta, random_pose(rng))
    return chart, delta, new_chart


def values_of(old: np.ndarray, new: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(L(0), old)
    values.insert(L(1), new)
    return values


@pytest.mark.parametrize("seed", range(20))
def test_residual_and_jacobians(seed):
    rng = np.random.default_rng(seed)
    chart, delta, new_chart = random_pair(rng)
    sigma = 0.01
    factor = same_line_factor(noiseModel.Isotropic.Sigma(4, sigma), L(0), L(1), chart, new_chart)
    np.testing.assert_allclose(
        factor.unwhitenedError(values_of(delta, np.zeros(4))), 0.0, atol=1e-12
    )
    old, new = delta + rng.normal(scale=0.05, size=4), rng.normal(scale=0.05, size=4)
    residual = factor.unwhitenedError(values_of(old, new))
    moment_and_direction, _ = chart.plucker(old)
    expected = new_chart.local(moment_and_direction[:3], moment_and_direction[3:]) - new
    np.testing.assert_allclose(residual, expected, atol=1e-9)
    A, b = factor.linearize(values_of(old, new)).jacobian()
    np.testing.assert_allclose(sigma * b, -residual, atol=1e-12)
    by_old = derivative(lambda d: factor.unwhitenedError(values_of(d, new)), old, 1e-4)
    by_new = derivative(lambda d: factor.unwhitenedError(values_of(old, d)), new, 1e-4)
    np.testing.assert_allclose(sigma * A, np.hstack([by_old, by_new]), atol=1e-7)


def test_the_covariance_travels_as_by_reanchor():
    rng = np.random.default_rng(0)
    chart, delta, new_chart = random_pair(rng)
    covariance = np.diag([0.01, 0.002, 0.003, 0.02])
    graph = gtsam.NonlinearFactorGraph()
    graph.addPriorVector(L(0), delta, noiseModel.Gaussian.Covariance(covariance))
    graph.add(same_line_factor(noiseModel.Isotropic.Sigma(4, 1e-4), L(0), L(1), chart, new_chart))
    marginals = gtsam.Marginals(graph, values_of(delta, np.zeros(4)))
    _, jacobian = chart.reanchor(delta, new_chart.world_T_anchor)
    np.testing.assert_allclose(
        marginals.marginalCovariance(L(1)), jacobian @ covariance @ jacobian.T, atol=1e-7
    )


def test_wrong_arguments_are_named():
    chart, _, new_chart = random_pair(np.random.default_rng(0))
    with pytest.raises(FactorError, match="dimension 3, but this factor has 4 rows"):
        same_line_factor(noiseModel.Isotropic.Sigma(3, 1.0), L(0), L(1), chart, new_chart)
    with pytest.raises(FactorError, match="new_chart"):
        same_line_factor(noiseModel.Isotropic.Sigma(4, 1.0), L(0), L(1), chart, None)
