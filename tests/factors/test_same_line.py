# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L

from ruledgraph_factors import FactorError, LineChart, same_line_factor


def random_pose(rng: np.random.Generator) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(scale=0.5, size=3)), rng.normal(size=3))


def random_line(rng: np.random.Generator) -> tuple[LineChart, np.ndarray, gtsam.Pose3]:
    """A chart, a line some way from its reference, and where to anchor it anew."""
    chart = LineChart.from_points(random_pose(rng), *rng.normal([0.0, 0.0, 4.0], size=(2, 3)))
    return chart, rng.normal(scale=0.3, size=4), random_pose(rng)


def values_of(old: np.ndarray, new: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(L(0), old)
    values.insert(L(1), new)
    return values


def test_the_same_line_has_no_error_to_first_order():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        chart, delta, anchor = random_line(rng)
        sigma = 0.01
        noise = noiseModel.Isotropic.Sigma(4, sigma)
        new_chart, _ = chart.reanchor(delta, anchor)
        factor = same_line_factor(noise, L(0), L(1), chart, delta, new_chart)
        plucker, _ = chart.plucker(delta)
        np.testing.assert_allclose(new_chart.local(plucker[:3], plucker[3:]), 0.0, atol=1e-9)
        assert factor.error(values_of(delta, np.zeros(4))) == 0.0
        for size in (1e-3, 1e-4):
            old = delta + rng.normal(scale=size, size=4)
            plucker, _ = chart.plucker(old)
            new = new_chart.local(plucker[:3], plucker[3:])
            # The chart's second derivatives are of the order of the scene's scales, some tens.
            assert np.sqrt(2.0 * factor.error(values_of(old, new))) * sigma < 1e3 * size**2
            off = new + rng.normal(scale=size, size=4)
            expected = 0.5 * np.sum((off - new) ** 2) / sigma**2
            assert factor.error(values_of(old, off)) == pytest.approx(expected, rel=2e3 * size)


def test_it_is_linear_about_the_estimate_wherever_it_is_linearised():
    rng = np.random.default_rng(1)
    chart, delta, anchor = random_line(rng)
    noise = noiseModel.Diagonal.Sigmas(np.array([0.1, 0.2, 0.3, 0.4]))
    new_chart, by_delta = chart.reanchor(delta, anchor)
    factor = same_line_factor(noise, L(0), L(1), chart, delta, new_chart)
    for old in (delta, np.zeros(4), rng.normal(size=4)):
        new = rng.normal(size=4)
        A, b = factor.linearize(values_of(old, new)).jacobian()
        whiten = np.diag(1.0 / noise.sigmas())
        np.testing.assert_allclose(A, whiten @ np.hstack([by_delta, -np.eye(4)]), atol=1e-12)
        np.testing.assert_allclose(b, -whiten @ (by_delta @ (old - delta) - new), atol=1e-9)


def test_the_covariance_travels_as_by_reanchor():
    rng = np.random.default_rng(0)
    chart, delta, anchor = random_line(rng)
    covariance = np.diag([0.02, 0.01, 0.002, 0.003])
    graph = gtsam.NonlinearFactorGraph()
    # Linearised elsewhere, as by a smoother that has stopped to linearise the old variable anew.
    graph.addPriorVector(L(0), delta, noiseModel.Gaussian.Covariance(covariance))
    noise = noiseModel.Isotropic.Sigma(4, 1e-4)
    new_chart, jacobian = chart.reanchor(delta, anchor)
    graph.add(same_line_factor(noise, L(0), L(1), chart, delta, new_chart))
    marginals = gtsam.Marginals(graph, values_of(np.zeros(4), np.zeros(4)))
    np.testing.assert_allclose(
        marginals.marginalCovariance(L(1)), jacobian @ covariance @ jacobian.T, atol=1e-7
    )


def test_a_linear_marginal_is_off_by_the_second_term_of_its_series():
    """A line that moved by d from where its points were linearised is found to about |d|^2 / 2."""
    over = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        chart = LineChart.from_points(gtsam.Pose3(), *rng.normal([0, 0, 4], 1.0, size=(2, 3)))
        # So near that the line was hardly known when its variable was fixed.
        cameras = np.vstack([np.zeros(3), rng.normal(scale=0.3, size=(6, 3))])
        moment, direction = np.split(chart.plucker(np.zeros(4))[0], 2)
        length = np.linalg.norm(direction)
        foot = np.cross(direction, moment) / length**2
        ends = [foot - 0.5 * direction / length, foot + 0.5 * direction / length]
        rays = np.swapaxes([end - cameras for end in ends], 0, 1)
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        moved = rng.normal(size=4)
        moved *= 0.15 / np.linalg.norm(moved)
        steps = 1e-6 * np.eye(4)
        ahead, behind = (
            np.column_stack([sines(chart, moved + sign * step, cameras, rays) for step in steps])
            for sign in (1, -1)
        )
        J, r = (ahead - behind) / 2e-6, sines(chart, moved, cameras, rays)
        by_marginal = moved - np.linalg.lstsq(J, r, rcond=None)[0]
        over.append(np.abs(by_marginal).max() / (0.5 * moved @ moved))
    # More of lines with so little parallax that the marginal itself hardly knows them.
    assert 0.5 < np.median(over) < 1.5


def sines(chart: LineChart, delta, cameras, rays) -> np.ndarray:
    """Of the angles between rays and the planes through camera centres and the line, (2 N,)."""
    moment, direction = np.split(chart.plucker(delta)[0], 2)
    normals = moment - np.cross(cameras, direction)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.einsum("ni,nki->nk", normals, rays).ravel()


def test_a_recentred_chart_and_one_of_other_signs_do_as_well():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        chart, delta, anchor = random_line(rng)
        noise = noiseModel.Isotropic.Sigma(4, 1.0)
        plucker, _ = chart.plucker(delta)
        for new_chart in (
            chart.recentred(delta)[0],
            LineChart.from_plucker(anchor, -plucker[:3], -plucker[3:]),
        ):
            factor = same_line_factor(noise, L(0), L(1), chart, delta, new_chart)
            old = delta + rng.normal(scale=1e-4, size=4)
            near, _ = chart.plucker(old)
            new = new_chart.local(near[:3], near[3:])
            residual = factor.unwhitenedError(values_of(old, new))
            np.testing.assert_allclose(residual, 0.0, atol=1e3 * 1e-8)


def test_wrong_arguments_are_named():
    rng = np.random.default_rng(0)
    chart, delta, anchor = random_line(rng)
    new_chart, _ = chart.reanchor(delta, anchor)
    noise = noiseModel.Isotropic.Sigma(4, 1.0)
    with pytest.raises(FactorError, match="dimension 3, but this factor has 4 rows"):
        same_line_factor(noiseModel.Isotropic.Sigma(3, 1.0), L(0), L(1), chart, delta, new_chart)
    with pytest.raises(FactorError, match="delta"):
        same_line_factor(noise, L(0), L(1), chart, delta[:3], new_chart)
    with pytest.raises(FactorError, match="new_chart must be a LineChart"):
        same_line_factor(noise, L(0), L(1), chart, delta, anchor)
    with pytest.raises(FactorError, match="not the line at delta of chart"):
        same_line_factor(noise, L(0), L(1), chart, delta + 0.1, new_chart)
    with pytest.raises(FactorError, match="new_line_key is the same key as line_key"):
        same_line_factor(noise, L(0), L(0), chart, delta, new_chart)
