# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from typing import NamedTuple

import numpy as np
import pytest

from ideal_tracks import CALIBRATION, at_rest, ideal_tracks
from ruledgraph.backend.states import Start
from ruledgraph.core.config import Config
from ruledgraph.initialization import initializer as module
from ruledgraph.initialization.initializer import Initializer
from ruledgraph.initialization.prior import Refusal
from simulated_window import hand_held


class Frame(NamedTuple):
    stamp: int
    time: float


def frames_of(made, until: float) -> list[Frame]:
    both = zip(made.stamps, made.times.tolist(), strict=True)
    return [Frame(stamp, time) for stamp, time in both if time <= until + 1e-9]


@pytest.fixture
def moving():
    return ideal_tracks(0, hand_held(np.random.default_rng(0)), rate=20.0, duration=1.6)


def test_no_attempt_before_there_is_a_window_and_then_at_intervals(moving, monkeypatch):
    lengths = []

    def refused(*arguments):
        times = arguments[2]
        lengths.append(times[-1] - times[0])
        return Refusal("none")

    monkeypatch.setattr(module, "start_in_motion", refused)
    initializer = Initializer(CALIBRATION, Config())
    tried = []
    for frame in frames_of(moving, 1.5):
        if initializer.is_due(frame.time):
            before = frames_of(moving, frame.time)
            if initializer.attempt(moving.imu, before, moving.tracks, None) is not None:
                tried.append(frame.time)
    np.testing.assert_allclose(tried, [0.6, 0.85, 1.1, 1.35], atol=1e-6)
    # The longest window there is, and the shortest one.
    np.testing.assert_allclose(lengths, [0.6, 0.85, 0.6, 1.1, 0.6, 1.25, 0.6], atol=1e-6)


def test_a_start_begins_at_the_first_frame_of_its_window(moving):
    initializer = Initializer(CALIBRATION, Config())
    frames = frames_of(moving, 1.5)
    start = initializer.attempt(moving.imu, frames, moving.tracks, None)
    assert isinstance(start, Start)
    assert start.time == pytest.approx(1.5 - Config().start.window)
    assert not initializer.is_due(1.6)


def test_at_rest_one_frame_is_enough():
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    frames = frames_of(made, 0.8)
    start = Initializer(CALIBRATION, Config()).attempt(made.imu, frames, [], 0.3)
    assert isinstance(start, Start)
    assert start.stamp == frames[-1].stamp
