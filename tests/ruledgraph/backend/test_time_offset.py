# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset of the camera: estimated, reported, followed by the times of frames."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from failing_smoother import fail_updates
from ideal_tracks import CALIBRATION, IdealTracks, error_of, frame_times, ideal_tracks, start_of
from ruledgraph.backend.sliding_window import Window
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, Gap, Measurement
from ruledgraph.core.messages import Messages
from ruledgraph.core.settings import load_config
from ruledgraph.evaluation import alignment
from ruledgraph.odometry import Odometry
from ruledgraph.synchronization.camera_clock import CameraClock, corrected_offset, offset_warning
from simulated_window import hand_held
from small_simulation import small_simulation, small_stream

PRIOR = TimeOffset(0.0, 0.01)
# With the noise of the tracks' points, which is independent from frame to frame.
ON, OFF = (
    load_config(None, [f"time_offset.estimate={way}", "edges.sigma_px=0.5", "edges.correlation=1"])
    for way in ("true", "false")
)


def run_window(made: IdealTracks, offset: float, following: bool = True) -> Window:
    """Frames taken `offset` later than their times say, until these are corrected."""
    window = Window(CALIBRATION, ON, start_of(made, time_offset=PRIOR))
    offset_correction = 0.0
    for first in range(1, len(made.times), 3):
        part = slice(first, first + 3)
        times = (made.times[part] - offset + offset_correction).tolist()
        window.extend(
            frame_times(made.stamps[part], times), made.imu, made.tracks, False, offset_correction
        )
        window.optimize()
        assert window.self_calibration.time_offset is not None
        if following:
            offset_correction = corrected_offset(
                offset_correction, window.self_calibration.time_offset, ON.time_offset
            )
    return window


def shaken(seed: int) -> IdealTracks:
    return ideal_tracks(seed, hand_held(np.random.default_rng(seed)))


@pytest.mark.parametrize("following", [True, False])
@pytest.mark.parametrize("offset", [-0.01, 0.0, 0.01])
def test_a_window_finds_the_offset(offset, following):
    """Within three sigmas; and 10 ms of delay do not show in the frames' poses."""
    made = shaken(1)
    window = run_window(made, offset, following)
    value, sigma = window.self_calibration.time_offset
    assert sigma < 1e-3
    assert abs(value - offset) < 3.0 * sigma
    assert window.recoveries == []
    interval = window.intervals[-2]
    for stamp, pose in zip(interval.stamps, interval.poses(), strict=True):
        assert error_of(pose, made.motion.pose(stamp * 1e-9)) < 0.01


def test_its_deviation_is_what_it_is_said_to_be():
    """Mean NEES of 24 windows: 99 % of such means of chi^2 of 1 lie in 0.40 to 1.90."""
    nees = []
    for seed in range(24):
        offset = float(np.random.default_rng([seed, 7]).normal(scale=PRIOR.sigma / 2))
        value, sigma = run_window(shaken(seed), offset).self_calibration.time_offset
        nees.append(((value - offset) / sigma) ** 2)
    assert 0.40 < np.mean(nees) < 1.90


def test_a_smoother_that_is_rebuilt_keeps_the_offset(monkeypatch):
    fail_updates(monkeypatch, 8, 13)
    window = run_window(shaken(1), 0.006)
    assert len(window.recoveries) == 2
    value, sigma = window.self_calibration.time_offset
    assert sigma < 1e-3
    assert abs(value - 0.006) < 3.0 * sigma


def test_a_correction_follows_in_steps_that_keep_frames_in_order():
    assert corrected_offset(0.001, TimeOffset(0.0015, 1e-4), ON.time_offset) == pytest.approx(
        0.0015
    )
    assert corrected_offset(0.001, TimeOffset(0.02, 1e-4), ON.time_offset) == pytest.approx(0.003)
    assert corrected_offset(0.001, TimeOffset(-0.02, 1e-4), ON.time_offset) == pytest.approx(-0.001)


@pytest.mark.parametrize(
    ("offset_correction", "offset", "warned"),
    [
        (0.005, TimeOffset(0.005, 2e-4), True),
        (-0.005, TimeOffset(-0.005, 2e-4), True),
        (0.003, TimeOffset(0.005, 2e-4), False),  # still on its way
        (0.005, TimeOffset(0.005, 2e-3), False),  # not well known
        (0.002, TimeOffset(0.002, 2e-4), False),  # not far
    ],
)
def test_an_offset_far_from_the_calibration_is_reported(offset_correction, offset, warned):
    message = offset_warning(offset_correction, offset, 0.0021, ON.time_offset)
    assert (message is not None) == warned
    if message and offset.value > 0.0:
        assert "t_imu - t_cam = 7.1 ± 0.2 ms" in message
        assert "not 2.1 ms" in message


def shifted(ms: int, moving: bool) -> tuple[list[Measurement], Calibration]:
    """The small recording with stamps of frames that are late by so much."""
    stream, calibration = small_stream(moving=moving)
    moved = [
        dataclasses.replace(m, stamp=m.stamp + ms * 10**6) if isinstance(m, Frame) else m
        for m in stream
    ]
    return sorted(moved, key=lambda m: m.stop if isinstance(m, Gap) else m.stamp), calibration


def run(measurements, calibration, config) -> tuple[Odometry, list[Estimate]]:
    odometry = Odometry(calibration, config)
    for measurement in measurements:
        odometry.add(measurement)
    odometry.finish()
    return odometry, odometry.take_live()


def ate(estimates: list[Estimate], ms: int, moving: bool) -> float:
    """RMSE of the aligned positions when the frames really were taken, m."""
    stamps = np.array([e.stamp for e in estimates]) - ms * 10**6
    true = small_simulation(moving=moving).truth(stamps).position
    own = np.array([e.world_T_body.translation() for e in estimates])
    A = alignment(own, true)
    return float(np.sqrt(np.mean(np.sum((own @ A[:3, :3].T + A[:3, 3] - true) ** 2, axis=1))))


@pytest.mark.parametrize(("ms", "moving"), [(-10, False), (10, True)], ids=["from rest", "moving"])
def test_the_odometry_gets_over_stamps_that_are_off(ms, moving):
    # It rests for too long to stay settled for a window, and is known to 1.2 ms.
    config = load_config(None, ["time_offset.settled_states=5"])
    odometry, live = run(*shifted(ms, moving), config)
    value, sigma = odometry.time_offset
    assert 0.0 < sigma < 1.5e-3
    assert abs(value + 1e-3 * ms) < 3.0 * sigma
    # But for the frames after the last live state, which `finish` takes in.
    assert live[-1].time_offset.value == pytest.approx(value, abs=2.0 * sigma)
    assert ate(live, ms, moving) < 0.02  # as without an offset
    assert sum("timeshift_cam_imu" in warning for warning in odometry.warnings) == 1


def test_an_offset_is_told_when_it_stays():
    warnings, sensors = Messages(), SimpleNamespace(offset_correction=0.02)
    clock = CameraClock(sensors, 0.0, ON.time_offset, warnings)
    states = ON.time_offset.settled_states
    for value in [0.02] * (states - 1) + [0.03] + [0.02] * states:
        sensors.offset_correction = 0.02
        assert list(warnings) == []
        clock.update(TimeOffset(value, 1e-4), confirmed=True)
    assert len(warnings) == 1
    assert "t_imu - t_cam = 20.0 ± " in str(warnings)


def test_a_start_that_is_not_confirmed_leaves_no_offset_behind():
    sensors = SimpleNamespace(offset_correction=0.0)
    clock = CameraClock(sensors, 0.0, ON.time_offset, Messages())
    before = clock.offset
    clock.update(TimeOffset(0.037, 1e-3), confirmed=False)
    assert clock.offset == before
    assert sensors.offset_correction == 0.0


def test_it_counts_from_the_calibration():
    measurements, calibration = shifted(10, moving=False)
    known = dataclasses.replace(calibration, time_offset=-0.009)
    odometry, live = run(measurements, known, ON)
    value, sigma = odometry.time_offset
    assert abs(value + 0.010) < 3.0 * sigma
    assert live[0].time_offset == TimeOffset(-0.009, 0.01)
    assert not any("timeshift_cam_imu" in warning for warning in odometry.warnings)


def test_without_estimating_the_calibration_stands():
    measurements, calibration = shifted(10, moving=False)
    known = dataclasses.replace(calibration, time_offset=-0.010)
    odometry, live = run(measurements, known, OFF)
    assert odometry.time_offset == TimeOffset(-0.010, 0.0)
    assert {e.time_offset for e in live} == {odometry.time_offset}
    assert ate(live, 10, moving=False) < 0.02


def test_an_offset_of_60_ms_is_found_before_the_start():
    """Further off than the window could see; within three sigmas, and the poses are good."""
    odometry, live = run(*shifted(60, moving=True), Config())
    value, sigma = odometry.time_offset
    assert odometry.calibration_search.used
    assert (
        abs(odometry.calibration_search.found.value + 0.060)
        < 3.0 * odometry.calibration_search.found.sigma
    )
    assert abs(value + 0.060) < 3.0 * sigma
    assert ate(live, 60, moving=True) < 0.02
    assert {e.segment for e in live} == {0}


def test_an_exact_offset_is_not_estimated():
    measurements, calibration = shifted(10, moving=False)
    exact = dataclasses.replace(calibration, time_offset=-0.010, time_offset_exact=True)
    odometry, live = run(measurements[: len(measurements) // 2], exact, ON)
    assert live
    assert odometry.time_offset == TimeOffset(-0.010, 0.0)
    assert odometry.calibration_search.found is None
