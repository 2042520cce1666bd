# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How segments of the trajectory end, and how the next ones begin."""

from dataclasses import replace

import numpy as np
import pytest

from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, Gap, ImuSample
from ruledgraph.core.settings import load_config
from ruledgraph.initialization.calibration_search import CalibrationSearch
from ruledgraph.integrity.gauge import yaw_alignment
from ruledgraph.odometry import Odometry
from ruledgraph.segments.trial import Trial
from ruledgraph.synchronization.synchronizer import Synchronizer
from small_runs import ate, run
from small_simulation import frames, small_simulation, small_stream


def test_a_gap_in_the_imu_begins_a_new_segment():
    stream, calibration = small_stream(moving=True)
    stamps = [m.stamp for m in stream if isinstance(m, ImuSample)]
    start, stop = stamps[int(0.5 * len(stamps))], stamps[int(0.62 * len(stamps))]
    cut = []
    for m in stream:
        if start < m.stamp < stop:
            continue
        if isinstance(m, ImuSample) and m.stamp == stop:
            cut.append(Gap(start, stop))
        cut.append(m)
    odometry, live, smoothed = run(cut, calibration)
    assert sum("a new segment begins" in warning for warning in odometry.warnings) == 1
    assert any(e.stamp < start for e in live)
    assert any(e.stamp > stop for e in live)
    # The new segment begins near where the last one ended, as its covariance says.
    before = [e for e in smoothed if e.stamp <= start][-1]
    after = next(e for e in smoothed if e.stamp >= stop)
    assert (before.segment, after.segment) == (0, 1)
    true = small_simulation(moving=True).truth(np.array([before.stamp, after.stamp]))
    turn = before.world_T_body.rotation().matrix() @ true.rotation[0].T
    error = after.world_T_body.translation() - before.world_T_body.translation()
    error -= turn @ (true.position[1] - true.position[0])
    R = after.world_T_body.rotation().matrix()
    covariance = R @ after.covariances[0][3:, 3:] @ R.T
    assert error @ np.linalg.solve(covariance, error) < 9.0
    assert np.sqrt(np.trace(covariance)) < 0.8
    attitudes = (e.world_T_body.rotation().matrix()[None] for e in (after, before))
    assert abs(yaw_alignment(*attitudes).yaw()) < 0.01


def without_frames(stream, start: float, stop: float):
    first = stream[0].stamp
    missing = (first + 1e9 * start, first + 1e9 * stop)
    return [m for m in stream if not (isinstance(m, Frame) and missing[0] < m.stamp < missing[1])]


def test_a_camera_that_is_silent_for_longer_than_the_window_begins_a_new_segment():
    stream, calibration = small_stream(duration=11.0)
    odometry, live, smoothed = run(without_frames(stream, 3.0, 7.5), calibration)  # lag: 4 s
    assert [w for w in odometry.warnings if "no frame for 4.5" in w]
    assert {e.segment for e in live} == {e.segment for e in smoothed} == {0, 1}


def test_frames_that_are_missing_for_less_are_reported():
    stream, calibration = small_stream(duration=6.0)
    odometry, live, _ = run(without_frames(stream, 3.0, 4.5), calibration)  # lag: 4 s
    (warning,) = (w for w in odometry.warnings if "no frame for 1.5" in w)
    assert "the IMU alone carried on" in warning
    assert {e.segment for e in live} == {0}


def test_an_estimate_that_diverged_ends_its_segment(monkeypatch):
    stream, calibration = small_stream(moving=True)
    plausible, calls = Window.is_plausible, []

    def diverges_once(self):
        calls.append(1)
        return plausible(self) and len(calls) != 8

    monkeypatch.setattr(Window, "is_plausible", diverges_once)
    odometry, live, smoothed = run(stream, calibration)
    assert sum("diverged" in warning for warning in odometry.warnings) == 1
    assert len(live) > 8  # it started again
    stamps = [e.stamp for e in smoothed]
    assert stamps == sorted(set(stamps))


def test_an_imu_that_is_silent_for_long_begins_a_new_segment_without_a_gap_message():
    stream, calibration = small_stream(moving=True)
    stamps = [m.stamp for m in stream if isinstance(m, ImuSample)]
    start, stop = stamps[int(0.5 * len(stamps))], stamps[int(0.65 * len(stamps))]
    cut = [m for m in stream if not (isinstance(m, ImuSample) and start < m.stamp < stop)]
    odometry, live, _ = run(cut, calibration)
    assert sum("no IMU for" in warning for warning in odometry.warnings) == 1
    assert any(e.stamp < start for e in live)
    assert any(e.stamp > stop for e in live)
    assert not any(start < e.stamp < stop for e in live)


def test_what_a_trial_held_back_is_handed_out_as_the_window_knows_it_by_then():
    stream, calibration = small_stream(moving=True)
    odometry = Odometry(calibration)
    released: list[Estimate] = []
    for measurement in stream:
        odometry.add(measurement)
        if released := odometry.take_live():
            break
    assert odometry.window is not None
    by_stamp = {estimate.stamp: estimate for estimate in released}
    compared = 0
    for interval in odometry.window.intervals:
        for stamp, pose in zip(interval.stamps, interval.poses(), strict=True):
            if stamp in by_stamp and stamp < released[-1].stamp:
                assert by_stamp[stamp].world_T_body.equals(pose, 1e-12)
                compared += 1
    assert compared > 10


@pytest.mark.parametrize("on_trial", [False, True])
def test_another_rotation_of_the_camera_begins_anew(monkeypatch, on_trial):
    """A window holds to the one that it began with."""
    stream, calibration = small_stream(moving=on_trial)
    odometry, begun = Odometry(calibration), []
    search = CalibrationSearch.search

    def replaces_once(self, *known):
        found = search(self, *known)
        if not begun and odometry.window is not None and odometry.window.newest.time > 0.5:
            begun.append(odometry.window)
            self.rotation_replaced = True
        return found

    monkeypatch.setattr(CalibrationSearch, "search", replaces_once)
    live = []
    for measurement in stream:
        odometry.add(measurement)
        live += odometry.take_live()
    assert len(begun) == 1
    assert odometry.window not in (None, begun[0])
    assert {e.segment for e in live} == ({0} if on_trial else {0, 1})


def test_a_start_on_moving_things_is_discarded(monkeypatch):
    stream, calibration = small_stream(moving=True)
    update, calls = Trial.update, []

    def refuted_once(self, window, lines_fit):
        update(self, window, lines_fit)
        calls.append(window)
        if len(calls) == 3:
            self.failure = "its lines were no good"

    monkeypatch.setattr(Trial, "update", refuted_once)
    odometry, statuses = Odometry(calibration), set()
    live, smoothed = [], []
    for measurement in stream:
        odometry.add(measurement)
        statuses.add(odometry.status)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
    odometry.finish()
    smoothed += odometry.take_smoothed()
    assert sum("is discarded: its lines" in warning for warning in odometry.warnings) == 1
    assert "initializing: the last start is discarded: its lines were no good" in statuses
    # Nothing of it was handed out, and the next one was.
    assert {e.segment for e in live + smoothed} == {0}
    assert len(live) > 20
    assert [e.stamp for e in live] == sorted({e.stamp for e in live})
    assert ate(live, small_simulation(moving=True)) < 0.03


def test_a_discarded_start_leaves_no_time_offset(monkeypatch):
    stream, calibration = small_stream(moving=True)
    late = [replace(m, stamp=m.stamp + 8_000_000) if isinstance(m, Frame) else m for m in stream]
    odometry, changes, left = Odometry(calibration), [], []
    retime = Synchronizer.retime

    def noted(self, change):
        changes.append(change)
        retime(self, change)

    def refuted(self, window, _lines_fit):
        left.append(window)
        self.failure = "its lines were no good"

    monkeypatch.setattr(Synchronizer, "retime", noted)
    monkeypatch.setattr(Trial, "update", refuted)
    for measurement in late:
        odometry.add(measurement)
        if left:
            break
    assert max(map(abs, changes)) > 5e-3
    assert sum(changes) == pytest.approx(0.0, abs=1e-12)


def test_a_start_that_a_recordings_end_leaves_on_trial_is_degraded():
    stream, calibration = small_stream(moving=True)
    odometry = Odometry(calibration)
    on_trial = 0
    for measurement in stream:
        odometry.add(measurement)
        if odometry.status == "initializing: the start is on trial":
            on_trial += isinstance(measurement, Frame)
        if on_trial == 6:
            break
    assert not odometry.take_live()
    odometry.finish()
    live, smoothed = odometry.take_live(), odometry.take_smoothed()
    assert len(live) == 6
    assert {e.status for e in live + smoothed} == {"degraded"}
    assert sum("was on trial" in warning for warning in odometry.warnings) == 1
    # One that was accepted is not.
    odometry, live, _ = run(stream, calibration)
    assert "tracking" in {e.status for e in live}
    assert not any("was on trial" in warning for warning in odometry.warnings)


def test_each_estimate_is_rated_by_its_own_covariance():
    """Live, held back on trial, and smoothed."""
    stream, calibration = small_stream(moving=True)
    most = 0.0045  # m/s, between the medians of live and smoothed ones
    config = load_config(None, [f"integrity.tracking_velocity_sigma={most}"])
    odometry, live, smoothed = run(stream, calibration, config)
    assert not odometry.warnings
    for estimates in (live, smoothed):
        known = [np.linalg.eigvalsh(e.covariances[1])[-1] < most**2 for e in estimates]
        assert [e.status == "tracking" for e in estimates] == known
        assert {e.status for e in estimates} == {"tracking", "degraded"}


def mirrored(measurements, after: float):
    """From so many s on the images are mirrored: they move against what the IMU feels."""
    start = frames(measurements)[0].stamp
    for measurement in measurements:
        if isinstance(measurement, Frame) and measurement.stamp > start + after * 1e9:
            image = np.ascontiguousarray(measurement.image[:, ::-1])
            yield Frame(measurement.stamp, image)
        else:
            yield measurement


def test_lines_that_contradict_the_imu_are_reported_and_flagged_or_end_the_segment():
    measurements, calibration = small_stream(seed=3)
    odometry, live = Odometry(calibration), []
    for measurement in mirrored(measurements, 2.5):
        odometry.add(measurement)
        live += odometry.take_live()
    told = "of the lines do not fit the estimate", "images and IMU have disagreed"
    assert any(text in warning for warning in odometry.warnings for text in told)
    flagged = sum(e.status == "degraded" for e in live) > 5
    assert flagged or "a new segment begins" in odometry.warnings[-1]
    # From when the velocity is known, a moment after the first motion.
    first = frames(measurements)[0].stamp
    before = [e for e in live if first + 1e9 < e.stamp < first + 2.4e9]
    assert all(e.status != "degraded" for e in before)


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_a_lost_estimate_ends_its_segment_at_its_last_reliable_state(seed):
    # Some cease to fit one or more states before most do.
    shares = {"agreed": 0.05, "max": 0.1, "lost": 0.35}
    config = load_config(None, [f"integrity.{k}_misfit={v}" for k, v in shares.items()])
    measurements, calibration = small_stream(seed=seed)
    odometry, live, smoothed = Odometry(calibration, config), [], []
    for measurement in mirrored(measurements, 2.5):
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
        if odometry.window is None and live:
            break
    assert "most lines do not fit the estimate" in odometry.warnings[-1]
    smoothed += odometry.take_smoothed()
    assert smoothed[-1].status == "degraded"
    last = odometry.last_reliable
    assert last is not None
    (index,) = (i for i, e in enumerate(live) if last.pose.equals(e.world_T_body, 1e-9))
    # Lines had ceased to fit before the window was given up.
    assert index < len(live) - 1
    assert all(e.status == "degraded" for e in live[index + 1 :])


def test_what_is_left_of_a_diverged_window_is_degraded():
    config = load_config(None, ["integrity.max_speed=0.1"])
    odometry, _, smoothed = run(*small_stream(), config)
    assert any("the estimate diverged" in warning for warning in odometry.warnings)
    ended = [e for e in smoothed if e.segment == 0]
    assert len(ended) > 10
    assert all(e.status == "degraded" for e in ended)


def spun(measurements, start, stop, rate):
    """The gyroscope feels a turn from start to stop, s, of a rate, rad/s."""
    first, turn = measurements[0].stamp, np.array([0.0, 0.0, rate])
    for measurement in measurements:
        if isinstance(measurement, ImuSample) and start < (measurement.stamp - first) * 1e-9 < stop:
            measurement = measurement._replace(gyroscope=measurement.gyroscope + turn)
        yield measurement


@pytest.mark.parametrize("start", [0.2, 2.5], ids=["before a start", "after it"])
def test_a_spin_by_more_than_half_a_turn_between_states_is_survived(start):
    measurements, calibration = small_stream(moving=True)
    _, live, _ = run(spun(measurements, start, start + 0.5, 18.0), calibration)
    assert live


def test_turning_to_and_fro_without_frames_does_not():
    measurements, calibration = small_stream(duration=11.0)
    first = measurements[0].stamp
    without = [
        m for m in measurements if not (isinstance(m, Frame) and 3.0 < (m.stamp - first) * 1e-9 < 6)
    ]
    swung = spun(list(spun(without, 3.0, 4.5, 1.5)), 4.5, 6.0, -1.5)
    odometry, _, _ = run(swung, calibration)
    assert not any("half a turn" in w for w in odometry.warnings)


def test_half_a_turn_without_frames_begins_a_new_segment():
    measurements, calibration = small_stream(duration=11.0)
    first = measurements[0].stamp
    without = [
        m for m in measurements if not (isinstance(m, Frame) and 3.0 < (m.stamp - first) * 1e-9 < 6)
    ]
    odometry, live, _ = run(spun(without, 3.0, 6.0, 1.5), calibration)
    assert any("more than half a turn between the frames" in w for w in odometry.warnings)
    assert max(e.segment for e in live) == 1
