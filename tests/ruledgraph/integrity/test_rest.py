# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np

from ideal_tracks import IdealTracks, at_rest, ideal_tracks
from ruledgraph.core.config import RestConfig
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.frame_history import FrameHistory, FrameTime
from ruledgraph.integrity.rest import RestDetector
from simulated_window import hand_held


def is_still(made: IdealTracks, image_motion: float, since: float | None = None) -> bool:
    frames = FrameHistory()
    for stamp, time in zip(made.stamps, made.times.tolist(), strict=True):
        frames.append(FrameTime(stamp, time))
    asked = []

    def motion(stamp: int, _at_rest: float, _min_lines: int) -> float:
        asked.append(stamp)
        return image_motion

    still = RestDetector(made.imu, frames, motion, RestConfig()).is_still(0.8, since)
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


def shaken(gyroscope: float, accelerometer: float) -> IdealTracks:
    """At rest, with readings that go up and down by so much about their means."""
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    made.imu = ImuBuffer()
    for i in range(200):
        sign = 1.0 if i % 2 else -1.0
        turn, force = np.array([0.01, 0.0, 0.0]), np.array([0.0, 0.0, 9.81])
        shake = np.array([0.0, sign, 0.0])
        made.imu.append(0.005 * i, turn + gyroscope * shake, force + accelerometer * shake)
    return made


def test_a_body_that_shakes_more_than_sensors_do_is_not_still():
    """By a standard deviation of 0.02 rad/s or 0.25 m/s^2."""
    assert is_still(shaken(0.016, 0.2), 0.1)
    assert not is_still(shaken(0.024, 0.2), 0.1)
    assert not is_still(shaken(0.016, 0.3), 0.1)
