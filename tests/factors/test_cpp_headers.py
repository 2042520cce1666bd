# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ headers compile and work without Python and GTSAM, and compute what Python does."""

from pathlib import Path

import gtsam
import numpy as np
import pytest

from cpp import CPP, Reader, build, numbers_of, run
from ruledgraph_factors import (
    GeometricPoints,
    ImuSamples,
    LineChart,
    ReprojectionPoints,
    line_from_ruling,
    preintegrate_frames,
)

BOUND = 1e-12


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(CPP / "core_test.cpp", tmp_path_factory.mktemp("cpp"))


def random_pose(rng: np.random.Generator) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3))


def assert_same(found: np.ndarray, expected: np.ndarray) -> None:
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(found, np.ravel(expected), rtol=0.0, atol=BOUND * scale)


def test_headers_pass_their_own_test_program(program: Path) -> None:
    assert run(program) == "passed\n"


def test_charts_are_those_of_python(program: Path) -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        anchor, other = random_pose(rng), random_pose(rng)
        first, second, to = rng.normal(size=(3, 3)) * 3.0
        along = (second - first) / np.linalg.norm(second - first)
        moment, delta = np.cross(first, along), rng.normal(size=4) * 0.3
        points = rng.uniform(-0.5, 0.5) + np.outer(np.linspace(0.0, 0.4, 9), [1.0, -0.7])
        points += rng.normal(size=points.shape) * 1e-3
        data = [0, anchor, other, moment, along, to, delta, len(points), points, 0.4]
        found = Reader(run(program, "values", text=numbers_of(data)))

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
        assert found.at_end


def test_motions_are_those_of_python(program: Path) -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.003, 0.007, size=60))
    gyroscope, accelerometer = rng.normal(size=(2, 60, 3)) * [[[1.0]], [[5.0]]]
    node, frames = times[3] + 0.001, times[3] + 0.001 + np.array([0.0, 0.02, 0.05, 0.11])
    vector, now = rng.normal(size=(2, 6)) * 0.05
    bias = gtsam.imuBias.ConstantBias(vector[:3], vector[3:])
    pose, velocity = random_pose(rng), rng.normal(size=3)
    samples = np.column_stack([times, accelerometer, gyroscope])
    data = [1, len(samples), samples, node, len(frames), frames, vector, pose, velocity, now]
    found = Reader(run(program, "values", text=numbers_of(data)))

    imu = ImuSamples(times, gyroscope, accelerometer)
    motion = preintegrate_frames(imu, node, frames, bias, with_time=True)
    state = gtsam.NavState(pose, velocity)
    poses = motion.poses(state, gtsam.imuBias.ConstantBias(now[:3], now[3:]))
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
def test_points_are_those_of_python(program: Path, cap: float) -> None:
    rng = np.random.default_rng(2)
    frames = [rng.uniform(-0.5, 0.5, size=(count, 2)) for count in (1, 3, 12)]
    data = [2, len(frames), *(part for frame in frames for part in (len(frame), frame)), cap]
    found = Reader(run(program, "values", text=numbers_of(data)))
    for C in GeometricPoints.from_frames(frames, effective_points=cap).statistics:
        assert_same(found.take(9), C.T @ C)
    individual = ReprojectionPoints.from_frames(frames, effective_points=cap)
    assert_same(found.take(32), individual.points)
    assert_same(found.take(16), individual.sqrt_weights)
    assert found.take(3).tolist() == [1.0, 3.0, 12.0]
    assert found.at_end
