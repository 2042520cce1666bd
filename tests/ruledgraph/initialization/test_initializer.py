# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest

from ideal_tracks import CALIBRATION, at_rest, ideal_tracks, sighting
from ruledgraph.backend.start import Start
from ruledgraph.core.config import Config
from ruledgraph.initialization.initializer import Refusal, start_at_rest, start_in_motion
from simulated_window import SEGMENTS, hand_held


def in_motion(seed: int, gyroscope_bias: float, segments=None) -> tuple:
    rng = np.random.default_rng(seed)
    bias = np.concatenate([rng.normal(scale=0.03, size=3), gyroscope_bias * np.ones(3) / 3**0.5])
    more = {} if segments is None else {"segments": segments}
    made = ideal_tracks(seed, hand_held(rng), duration=1.0, bias=bias, **more)
    start = start_in_motion(
        made.imu, made.stamps, made.times.tolist(), made.tracks, CALIBRATION, Config()
    )
    return made, start


@pytest.mark.parametrize("seed", range(6))
def test_a_start_in_motion_finds_velocity_gravity_and_a_large_gyroscope_bias(seed):
    made, start = in_motion(seed, gyroscope_bias=0.08)
    assert isinstance(start, Start)
    body_R_world = made.motion.rotation(0.0).T
    own_R_world = start.state.attitude().matrix().T
    velocity = own_R_world @ start.state.velocity()
    # 0.5 px of noise, a second of motion with an unknown accelerometer bias of 0.03 m/s^2.
    np.testing.assert_allclose(velocity, body_R_world @ made.motion.velocity(0.0), atol=0.04)
    np.testing.assert_allclose(start.bias.gyroscope(), made.bias[3:], atol=4e-3)
    down = np.array([0.0, 0.0, -1.0])
    angle = np.arccos(np.clip((own_R_world @ down) @ (body_R_world @ down), -1.0, 1.0))
    assert np.degrees(angle) < 2.0  # 0.2 m/s^2 of bias, twice its prior, are 1.2 degrees
    assert len(start.lines) >= 8


def test_too_few_lines_are_refused_with_the_reason():
    _, refusal = in_motion(0, 0.0, SEGMENTS)
    assert isinstance(refusal, Refusal)
    assert refusal.reason == "4 lines were followed long enough, 6 are needed"


def test_wrong_associations_are_refused():
    made, _ = in_motion(1, 0.0)
    rng = np.random.default_rng(0)
    for track in made.tracks:
        for i, seen in enumerate(track.sightings):
            moved = seen.points + rng.normal(scale=0.02, size=2)
            track.sightings[i] = sighting(seen.stamp, moved)
    refusal = start_in_motion(
        made.imu, made.stamps, made.times.tolist(), made.tracks, CALIBRATION, Config()
    )
    assert isinstance(refusal, Refusal)


def test_a_start_at_rest_finds_gravity_and_the_gyroscope_bias():
    bias = np.array([0.0, 0.0, 0.0, 0.02, -0.05, 0.08])
    made = ideal_tracks(0, at_rest(1.0), duration=0.9, bias=bias)
    start = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(start, Start)
    np.testing.assert_allclose(start.bias.gyroscope(), bias[3:], atol=2e-3)
    np.testing.assert_array_equal(start.state.velocity(), 0.0)
    true_up = made.motion.rotation(0.0).T @ [0.0, 0.0, 1.0]
    own_up = start.state.attitude().matrix().T @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arccos(true_up @ own_up)) < 0.1
    # Yaw is the world's choice, and held tighter than the tilt.
    up_variance = own_up @ start.pose_covariance[:3, :3] @ own_up
    assert up_variance == pytest.approx(1e-8)


def test_an_accelerometer_in_g_is_refused_at_rest():
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    samples = made.imu.between(0.0, 0.9)
    made.imu.clear()
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        made.imu.append(float(time), w, f / 9.81)
    refusal = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(refusal, Refusal)
    assert "1.00 instead of 9.81" in refusal.reason


def test_a_start_moves_to_where_the_last_segment_ended():
    _, start = in_motion(2, 0.0)
    moved = start.moved(gtsam.Pose3(gtsam.Rot3.Yaw(0.7), np.array([1.0, 2.0, 3.0])))
    turn = gtsam.Rot3.Yaw(0.7)
    np.testing.assert_allclose(moved.state.position(), [1.0, 2.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(moved.state.velocity(), turn.rotate(start.state.velocity()))
    number, (chart, delta) = next(iter(start.lines.items()))
    before, _ = chart.closest_point(delta)
    after, _ = moved.lines[number][0].closest_point(delta)
    np.testing.assert_allclose(after, turn.rotate(before) + np.array([1.0, 2.0, 3.0]), atol=1e-9)
