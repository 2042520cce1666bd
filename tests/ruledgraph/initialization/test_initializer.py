# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from types import SimpleNamespace

import numpy as np
import pytest

from ideal_tracks import CALIBRATION, IdealTracks, at_rest, ideal_tracks
from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.core.config import Config
from ruledgraph.core.output import Output
from ruledgraph.initialization import initializer as module
from ruledgraph.initialization.calibration_search import CalibrationSearch
from ruledgraph.initialization.initializer import FirstFrames, Initializer
from ruledgraph.initialization.prior import Refusal
from ruledgraph.integrity.rest import RestDetector
from ruledgraph.stages import Stages
from ruledgraph.synchronization.camera_clock import CameraClock
from ruledgraph.synchronization.frame_history import FrameTime
from ruledgraph.synchronization.synchronizer import Synchronizer
from simulated_window import hand_held


class Run:
    """The frames of made-up tracks, one by one, and an initializer that sees them."""

    def __init__(self, made: IdealTracks, image_motion: float) -> None:
        self.output = Output()
        self.sensors = Synchronizer(CALIBRATION, self.output.warnings)
        samples = made.imu.between(made.imu.earliest, made.imu.latest)
        for sample in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
            self.sensors.imu.append(*sample)
        front_end = SimpleNamespace(observed=lambda: made.tracks, retime=lambda _: None)
        config = Config()

        def lines_moved(_since: int):
            return np.ones((5, 3)), np.full(5, image_motion)

        rest = RestDetector(self.sensors.imu, self.sensors.frames, lines_moved, config.rest)
        online_calibration = OnlineCalibration(CALIBRATION, config, self.output.warnings)
        warnings, given = self.output.warnings, CALIBRATION.time_offset
        clock = CameraClock(self.sensors, given, config.time_offset, warnings)
        calibration_search = CalibrationSearch(online_calibration, clock, config, warnings)
        stages = Stages(self.sensors, front_end, rest, clock, online_calibration, self.output)
        self.initializer = Initializer(stages, calibration_search, config)
        both = zip(made.stamps, made.times.tolist(), strict=True)
        self._frames = [FrameTime(stamp, time) for stamp, time in both]

    def attempts(self, until: float) -> list[tuple[float, FirstFrames | None]]:
        """What comes of each frame up to a time."""
        found = []
        for frame in self._frames:
            if frame.time <= until + 1e-9:
                self.sensors.frames.append(frame)
                found.append((frame.time, self.initializer.attempt(frame)))
        return found


@pytest.fixture
def moving():
    return ideal_tracks(0, hand_held(np.random.default_rng(0)), rate=20.0, duration=1.6)


def test_no_attempt_before_there_is_a_window_and_then_at_intervals(moving, monkeypatch):
    lengths, tried = [], []

    def refused(_imu, frames, *_):
        tried.append(frames[-1].time)
        lengths.append(frames[-1].time - frames[0].time)
        return Refusal("none")

    monkeypatch.setattr(module, "start_in_motion", refused)
    run = Run(moving, image_motion=5.0)
    assert all(found is None for _, found in run.attempts(1.5))
    np.testing.assert_allclose(sorted(set(tried)), [0.9, 1.15, 1.4], atol=1e-6)
    # The longest window there is, and the shortest one, where they differ.
    np.testing.assert_allclose(lengths, [0.9, 1.15, 0.9, 1.4, 0.9], atol=1e-6)
    assert "no start at 0.90 s: none" in run.output.warnings[0]


def test_a_start_begins_at_the_first_frame_of_its_window(moving):
    found = [f for _, f in Run(moving, image_motion=5.0).attempts(1.5) if f is not None]
    assert found
    assert found[0].frames[0].stamp == found[0].start.stamp
    assert found[0].frames[0].time == pytest.approx(found[0].start.time)


def test_a_start_whose_time_offset_is_doubted_waits(moving, monkeypatch):
    run, offsets = Run(moving, image_motion=5.0), []

    def contradicts_known(_search, offset):
        offsets.append(offset)
        return len(offsets) == 1

    monkeypatch.setattr(CalibrationSearch, "contradicts_known", contradicts_known)
    run.sensors.offset_correction = 0.02
    found = [(time, f) for time, f in run.attempts(1.5) if f is not None]
    assert found[0][0] == pytest.approx(1.15)  # at the second attempt
    assert "the start suggests a time offset" in run.output.warnings[0]
    # The frames were taken at their times, which are so much later than their stamps.
    assert offsets == pytest.approx([CALIBRATION.time_offset + 0.02] * len(offsets), abs=2e-3)


def test_at_rest_one_frame_is_enough():
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    found = [(time, f) for time, f in Run(made, image_motion=0.1).attempts(0.8) if f is not None]
    time, first = found[0]
    assert time < Config().rest.duration + 0.1  # as soon as rest has lasted
    assert [frame.time for frame in first.frames] == [time]
