# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ headers compile and work without Python and GTSAM, and compute what Python does."""

from pathlib import Path

import gtsam
import numpy as np
import pytest

from cpp import CPP, Reader, headers_of, numbers_of, run, together_group
from ruledgraph_factors import (
    GeometricPoints,
    ImuSamples,
    LineChart,
    ReprojectionPoints,
    line_from_ruling,
    preintegrate_frames,
    triangulate_line,
)

pytestmark = together_group
BOUND = 1e-12


def random_pose(rng: np.random.Generator) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3))


def assert_same(found: np.ndarray, expected: np.ndarray) -> None:
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(found, np.ravel(expected), rtol=0.0, atol=BOUND * scale)


def test_headers_pass_their_own_test_program(together: Path) -> None:
    assert run(together, "core") == "passed\n"


def test_headers_include_nothing_of_gtsam() -> None:
    # There would be no such file: here the compiler is not told where the stand-in is.
    assert len(headers_of(CPP / "core_test.cpp")) > 5


def test_charts_are_those_of_python(together: Path) -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        anchor, other = random_pose(rng), random_pose(rng)
        first, second, to = rng.normal(size=(3, 3)) * 3.0
        along = (second - first) / np.linalg.norm(second - first)
        moment, delta = np.cross(first, along), rng.normal(size=4) * 0.3
        points = rng.uniform(-0.5, 0.5) + np.outer(np.linspace(0.0, 0.4, 9), [1.0, -0.7])
        points += rng.normal(size=points.shape) * 1e-3
        far = rng.normal(size=4) * 2.0
        data = [0, anchor, other, moment, along, to, delta, len(points), points, 0.4, far]
        found = Reader(run(together, "core", "values", text=numbers_of(data)))

        chart = LineChart.from_plucker(anchor, moment, along)
        new_chart, by_delta = chart.reanchor(delta, other)
        for expected in (
            *chart.plucker(delta),
            *chart.direction(delta),
            *chart.closest_point(delta),
            *chart.closest_point(delta, to),
            chart.basis,
            chart.angle,
            new_chart.basis,
            new_chart.angle,
            by_delta,
        ):
            assert_same(found.take(np.size(expected)), expected)
        guessed = line_from_ruling(anchor, points, 0.4)
        basis = found.take(9).reshape(3, 3)
        # Two directions of one line: u1 and u2 turn round together.
        sign = np.sign(basis[:, 0] @ guessed.basis[:, 0])
        assert_same((basis * [sign, sign, 1.0]).ravel(), guessed.basis)
        assert_same(found.take(1), np.array(guessed.angle))
        assert_same(found.take(4), new_chart.local(*np.split(chart.plucker(delta)[0], 2)))
        for expected in (*chart.wrapped(far), float(chart.is_far(far))):
            assert_same(found.take(np.size(expected)), np.asarray(expected))
        centred, by_far = chart.recentred(far)
        for expected in (centred.basis, centred.angle, by_far):
            assert_same(found.take(np.size(expected)), np.asarray(expected))
        assert found.at_end


def test_motions_are_those_of_python(together: Path) -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.003, 0.007, size=60))
    gyroscope, accelerometer = rng.normal(size=(2, 60, 3)) * [[[1.0]], [[5.0]]]
    start, frames = times[3] + 0.001, times[3] + 0.001 + np.array([0.0, 0.02, 0.05, 0.11])
    vector, now = rng.normal(size=(2, 6)) * 0.05
    bias = gtsam.imuBias.ConstantBias(vector[:3], vector[3:])
    pose, velocity = random_pose(rng), rng.normal(size=3)
    samples = np.column_stack([times, accelerometer, gyroscope])
    data = [1, len(samples), samples, start, len(frames), frames, vector, pose, velocity, now, 0.01]
    found = Reader(run(together, "core", "values", text=numbers_of(data)))

    imu = ImuSamples(times, gyroscope, accelerometer)
    motion = preintegrate_frames(imu, start, frames, bias, with_time=True)
    state = gtsam.NavState(pose, velocity)
    bias_now = gtsam.imuBias.ConstantBias(now[:3], now[3:])
    poses = motion.poses(state, bias_now, time_shift=0.01)
    assert motion.time_jacobian is not None
    for i, frame_pose in enumerate(poses):
        for expected in (
            motion.elapsed[i],
            motion.preintegrated[i, :6],
            motion.bias_jacobian[i, :6],
            motion.time_jacobian[i],
            frame_pose.rotation().matrix(),
            frame_pose.translation(),
        ):
            assert_same(found.take(np.size(expected)), np.asarray(expected))
    assert found.at_end


@pytest.mark.parametrize("cap", [1e9, 4.0])
def test_points_are_those_of_python(together: Path, cap: float) -> None:
    rng = np.random.default_rng(2)
    frames = [rng.uniform(-0.5, 0.5, size=(count, 2)) for count in (1, 3, 12)]
    data = [2, len(frames), *(part for frame in frames for part in (len(frame), frame)), cap]
    found = Reader(run(together, "core", "values", text=numbers_of(data)))
    compressed = GeometricPoints.from_frames(frames, effective_points=cap)
    for C in compressed.statistics:
        assert_same(found.take(9), C.T @ C)
    for C in compressed.without_scatter().statistics:
        assert_same(found.take(9), C.T @ C)
        assert not found.take(3).any()
    individual = ReprojectionPoints.from_frames(frames, effective_points=cap)
    assert_same(found.take(32), individual.points)
    assert_same(found.take(16), individual.sqrt_weights)
    assert found.take(3).tolist() == [1.0, 3.0, 12.0]
    assert_same(found.take(6), compressed.middles().T)
    assert_same(found.take(6), individual.middles().T)
    assert_same(found.take(2), np.array([compressed.weight, individual.weight]))
    assert found.at_end


STATUS = ("determined", "no_baseline", "within_plane", "no_parallax", "behind_camera")


def views(kind: str, seed: int) -> tuple[list[gtsam.Pose3], list[np.ndarray]]:
    """Cameras and what they see of an edge 3 m in front of the first."""
    rng = np.random.default_rng(seed)
    ends = np.array([[-0.5, 0.3, 3.0], [0.6, 0.4, 3.3]]) + rng.normal(size=(2, 3)) * 0.1
    steps = {
        "determined": np.array([0.05, 0.1, 0.0]),
        "no_baseline": np.zeros(3),
        "within_plane": (ends[1] - ends[0]) * 0.1,
        "no_parallax": np.array([0.0, 1e-4, 0.0]),
        "behind_camera": np.array([0.05, 0.1, 0.0]),
    }
    start = random_pose(rng)
    cameras, points = [], []
    for j in range(4):
        camera = gtsam.Pose3(
            gtsam.Rot3.Expmap(rng.normal(size=3) * 0.02 * (j > 0)), j * steps[kind]
        )
        share = rng.uniform(size=(12, 1))
        inside = np.array([camera.transformTo(e) for e in ends[0] + share * (ends[1] - ends[0])])
        cameras.append(start * camera)
        points.append(inside[:, :2] / inside[:, 2:] + rng.normal(size=(12, 2)) * 1e-3)
    if kind == "behind_camera":  # as if the cameras had moved the other way
        moved = [start.between(camera) for camera in cameras]
        cameras = [start * gtsam.Pose3(c.rotation(), -c.translation()) for c in moved]
    return cameras, points


@pytest.mark.parametrize("kind", STATUS)
def test_triangulated_lines_are_those_of_python(together: Path, kind: str) -> None:
    for seed in range(4):
        cameras, points = views(kind, seed)
        parts = [part for view in points for part in (len(view), view)]
        data = [3, len(cameras), *cameras, len(points), *parts, 1e-3]
        found = Reader(run(together, "core", "values", text=numbers_of(data)))
        expected = triangulate_line(cameras, points, 1e-3)
        assert expected.status == kind
        basis = found.take(9).reshape(3, 3)
        sign = np.sign(basis[:, 0] @ expected.chart.basis[:, 0])
        assert_same((basis * [sign, sign, 1.0]).ravel(), expected.chart.basis)
        assert_same(found.take(1), np.array(expected.chart.angle))
        # u1 and u2 turned round: delta[1] and delta[2] change their signs.
        signs = np.array([1.0, sign, sign, 1.0])
        covariance = found.take(16).reshape(4, 4) * np.outer(signs, signs)
        assert_same(covariance.ravel(), expected.covariance)
        assert_same(found.take(1), np.array(expected.rms))
        assert STATUS[int(found.take(1)[0])] == kind
        assert found.at_end
