# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ideal_tracks import IdealTracks, at_rest, ideal_tracks
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import RestConfig
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.integrity.rest import RestDetector
from ruledgraph.synchronization.frame_history import FrameHistory, FrameTime
from simulated_window import hand_held


def is_still(made: IdealTracks, image_motion: float, since: float | None = None) -> bool:
    frames = FrameHistory()
    for stamp, time in zip(made.stamps, made.times.tolist(), strict=True):
        frames.append(FrameTime(stamp, time))
    asked = []

    def lines_moved(stamp: int) -> tuple[FloatArray, FloatArray]:
        asked.append(stamp)
        seen = 5 if np.isfinite(image_motion) else 0
        return np.ones((seen, 3)), np.full(seen, image_motion)

    still = RestDetector(made.imu, frames, lines_moved, RestConfig()).is_still(0.8, since)
    if since is not None and still:
        assert abs(asked[-1] * 1e-9 - since) < 0.04  # the frame then, at 30 Hz
    return still


def test_what_moves_is_not_still():
    resting = ideal_tracks(0, at_rest(1.0), duration=0.9)
    assert is_still(resting, 0.1)
    assert is_still(resting, 0.1, since=0.2)
    assert not is_still(resting, 5.0)
    assert not is_still(resting, np.inf)
    assert not is_still(ideal_tracks(0, hand_held(np.random.default_rng(0)), duration=0.9), 0.1)


def shaken(
    frequency: float, accelerometer: float, gyroscope: float = 0.0, phase: float = 0.0
) -> IdealTracks:
    """At rest, with readings that go up and down by so much (amplitudes) so often a second."""
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    made.imu = ImuBuffer()
    for time in np.arange(0.0, 1.0, 0.005).tolist():
        turn, force = np.array([0.01, 0.0, 0.0]), np.array([0.0, 0.0, 9.81])
        shake = np.array([0.0, np.cos(2.0 * np.pi * frequency * time + phase), 0.0])
        made.imu.append(time, turn + gyroscope * shake, force + accelerometer * shake)
    return made


def test_a_body_that_vibrates_is_still_while_its_velocity_and_attitude_are_those_of_a_rest():
    """An acceleration of amplitude a at a frequency f is a velocity of amplitude a / (2 pi f), and
    up to twice that from what it is at first.
    """
    config = RestConfig()
    for frequency in (10.0, 20.0, 25.0):
        circular = 2.0 * np.pi * frequency
        fast, far = 3.0 * config.velocity_sigma * circular, 3.0 * config.pose_sigma * circular
        for phase in np.linspace(0.0, 6.0, 7).tolist():
            assert is_still(shaken(frequency, 0.45 * fast, 0.0, phase), 0.1)
            assert not is_still(shaken(frequency, 1.2 * fast, 0.0, phase), 0.1)
            assert is_still(shaken(frequency, 0.0, 0.45 * far, phase), 0.1)
            assert not is_still(shaken(frequency, 0.0, 1.2 * far, phase), 0.1)


def test_noise_of_eight_times_a_consumer_imus_is_rest():
    rng = np.random.default_rng(0)
    density = 8.0 * np.array([1.7e-4, 2e-3])
    deviations = np.repeat(density / np.sqrt(0.005), 3)
    for _ in range(20):
        made = ideal_tracks(0, at_rest(1.0), duration=0.9)
        made.imu = ImuBuffer()
        for i in range(200):
            reading = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.81]) + rng.normal(size=6) * deviations
            made.imu.append(0.005 * i, reading[:3], reading[3:])
        assert is_still(made, 0.1)


@pytest.mark.parametrize("acceleration", [0.3, 1.0, 3.0])
def test_a_body_that_sets_off_is_not_still_before_it_is_fast(acceleration):
    """When it moves at 30 mm/s at most, twice what a resting body may."""
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    made.imu = ImuBuffer()
    sets_off = 0.8 - 0.03 / acceleration
    for time in np.arange(0.0, 1.0, 0.005).tolist():
        force = np.array([acceleration if time > sets_off else 0.0, 0.0, 9.81])
        made.imu.append(time, np.zeros(3), force)
    assert not is_still(made, 0.1)
