# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines that ended in a wrong minimum are told from those that did not."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, X

from ruledgraph_factors import (
    GeometricPoints,
    LineChart,
    LineCheck,
    ReprojectionPoints,
    check_lines,
    ruled_surface_pose_factor,
)

SIGMA = 1e-3
ENDS = np.array([[-0.6, -0.3, 2.0], [0.5, 0.4, 2.5]])


def a_graph(kind: type, seed: int = 0, frames: int = 10, scatter: bool = True) -> tuple:
    """A camera that moves sideways sees a line; the chart's reference is the true one."""
    rng = np.random.default_rng(seed)
    chart = LineChart.from_points(gtsam.Pose3(), *ENDS)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(L(0), np.zeros(4))
    huber = noiseModel.mEstimator.Huber.Create(9.0)
    for k in range(frames):
        pose = gtsam.Pose3(gtsam.Rot3.Expmap(0.05 * rng.normal(size=3)), [0.02 * k, -0.03 * k, 0])
        values.insert(X(k), pose)
        seen = np.array([pose.transformTo(p) for p in np.linspace(*ENDS, 20)])
        image = seen[:, :2] / seen[:, 2:] + rng.normal(scale=SIGMA, size=(20, 2))
        points = kind.from_frames([image])
        points = points if scatter else points.without_scatter()
        noise = noiseModel.Robust.Create(huber, noiseModel.Isotropic.Sigma(points.rows, SIGMA))
        graph.add(ruled_surface_pose_factor(noise, X(k), L(0), chart, points))
    return graph, values, chart


def checked(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, delta: list) -> LineCheck:
    values = gtsam.Values(values)
    values.update(L(0), np.asarray(delta, dtype=float))
    (found,) = check_lines(graph, values)
    return found


@pytest.mark.parametrize("kind", [GeometricPoints, ReprojectionPoints])
def test_the_true_line_is_ok(kind: type) -> None:
    for seed in range(20):
        graph, values, _ = a_graph(kind, seed)
        graph.addPriorPose3(X(0), gtsam.Pose3(), noiseModel.Unit.Create(6))
        found = checked(graph, values, [0, 0, 0, 0])
        assert found.ok, found
        assert found.expected == pytest.approx(200.0)
        assert abs(found.chi_squared - 200.0) < 4.0 * np.sqrt(400.0)
        assert str(found).endswith("ok")


def test_without_scatter_two_a_frame_are_expected() -> None:
    found = []
    for seed in range(20):
        graph, values, _ = a_graph(GeometricPoints, seed, scatter=False)
        found.append(checked(graph, values, [0, 0, 0, 0]))
        assert found[-1].ok, found[-1]
        assert found[-1].expected == 20.0
    # The mean of 20 chi-squares with 20 degrees of freedom deviates by sqrt(2); four times that.
    assert abs(np.mean([check.chi_squared for check in found]) - 20.0) < 4.0 * np.sqrt(2.0)
    # Points with their scatter, 200 expected, would hide this one.
    misplaced = checked(graph, values, [0, 0, 0, 1.5 * SIGMA])
    assert misplaced.misfit
    assert misplaced.chi_squared < 200.0


def test_a_wrong_distance_and_a_wrong_direction_are_misfits() -> None:
    graph, values, _ = a_graph(GeometricPoints)
    for wrong in ([0.1, 0, 0, 0], [0, 0.3, 0, 0]):
        found = checked(graph, values, wrong)
        assert (found.misfit, found.ok) == (True, False)
        assert "its points contradict it" in str(found)


def test_a_line_behind_the_cameras_is_told() -> None:
    graph, values, chart = a_graph(GeometricPoints, frames=1)
    # The same ruling in the one frame, beyond infinity.
    found = checked(graph, values, [-2.0 * chart.angle, 0, 0, 0])
    assert (found.misfit, found.behind, found.ok) == (False, 1.0, False)
    assert "behind the cameras" in str(found)


def test_a_wrapped_line_is_far() -> None:
    graph, values, _ = a_graph(GeometricPoints)
    found = checked(graph, values, [np.pi, 0, 0, 0])
    assert (found.misfit, found.behind, found.far, found.ok) == (False, 0.0, True, False)


def test_the_limit_is_the_quantile() -> None:
    limits = {round(check.expected): check.limit for check in map(limit_of, (20, 200))}
    # Tables of the chi-squared distribution at 99.9 %; the approximation is good to 0.3 %.
    assert limits[20] == pytest.approx(45.31, rel=5e-3)
    assert limits[200] == pytest.approx(267.54, rel=5e-3)


def limit_of(points: int) -> LineCheck:
    graph, values, _ = a_graph(GeometricPoints, frames=points // 20)
    return checked(graph, values, [0, 0, 0, 0])
