# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines that ended in a wrong minimum are told from those that did not."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, X

from ruledgraph_factors import (
    FactorSpec,
    GeometricPoints,
    LineChart,
    LineCheck,
    ReprojectionPoints,
    build_factor,
    check_lines,
    line_distance_factor,
    move_line,
    new_line_factor,
    ruled_surface_pose_factor,
    same_line_factor,
    spec_of,
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


@pytest.mark.parametrize("other", ["observation", "prior", "distance", "same line"])
def test_two_charts_on_one_key_are_told(other: str) -> None:
    graph, values, chart = a_graph(GeometricPoints)
    pose = values.atPose3(X(3))
    moved, _ = chart.reanchor(np.zeros(4), pose)  # the same line, but other coordinates
    if other == "observation":
        points = GeometricPoints.from_frames([[[0.0, 0.0], [0.1, 0.1]]])
        noise = noiseModel.Isotropic.Sigma(3, 1.0)
        graph.add(ruled_surface_pose_factor(noise, X(3), L(0), moved, points))
    elif other == "prior":
        graph.add(new_line_factor(noiseModel.Unit.Create(4), X(3), L(0), moved, pose))
    elif other == "distance":
        graph.add(line_distance_factor(noiseModel.Unit.Create(1), X(3), L(0), moved, 2.0))
    else:
        noise = noiseModel.Unit.Create(4)
        graph.add(same_line_factor(noise, L(0), L(1), moved, np.zeros(4), chart))
    found = checked(graph, values, [0, 0, 0, 0])
    assert (found.mixed_charts, found.ok) == (True, False)
    assert str(found).startswith("l0: ")
    assert "different charts" in str(found)


def test_charts_of_copies_and_of_tied_keys_are_no_mixture() -> None:
    graph, values, chart = a_graph(GeometricPoints)
    values.insert(L(1), np.zeros(4))
    moved, _ = chart.reanchor(np.zeros(4), values.atPose3(X(3)))
    noise = noiseModel.Unit.Create(4)
    graph.add(same_line_factor(noise, L(0), L(1), chart, np.zeros(4), moved))
    graph.push_back(move_line(graph, L(0), L(1), moved).factors)
    stored = [build_factor(type(spec).from_dict(spec.to_dict())) for spec in specs(graph)]
    for factor in stored:  # equal charts, but not the same objects
        graph.add(factor)
    checks = check_lines(graph, values)
    assert [check.key for check in checks] == [L(0), L(1)]
    assert not any(check.mixed_charts for check in checks)


def specs(graph: gtsam.NonlinearFactorGraph) -> list[FactorSpec]:
    found = [spec_of(graph.at(index)) for index in range(graph.size())]
    return [spec for spec in found if spec is not None]


@pytest.mark.parametrize("kind", [GeometricPoints, ReprojectionPoints])
@pytest.mark.parametrize("kernel", ["numpy", "native"])
def test_nan_is_told_of_its_line(kind: type, kernel: str, monkeypatch) -> None:
    monkeypatch.setenv("RULEDGRAPH_KERNEL", kernel)
    graph, values, _ = a_graph(kind)
    for delta in ([np.nan, 0, 0, 0], [0, 0, 0, np.nan]):
        found = checked(graph, values, delta)
        assert (found.key, found.undefined, found.far, found.ok) == (L(0), True, False, False)
        assert str(found).startswith("l0: ")
        assert "NaN" in str(found)
