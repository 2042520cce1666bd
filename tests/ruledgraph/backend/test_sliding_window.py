# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The sliding window: its states in motion and at rest, and its lines."""

from dataclasses import replace
from itertools import pairwise

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from ideal_tracks import (
    CALIBRATION,
    MANY,
    IdealTracks,
    error_of,
    frame_times,
    ideal_tracks,
    sighting,
    start_of,
)
from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_factors import new_line_factors
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.start import InitialLine
from ruledgraph.backend.states import Interval
from ruledgraph.core.config import Config
from ruledgraph.core.settings import load_config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph_factors import LineChart, RuledSurfaceFactor
from simulated_window import SplineMotion, hand_held
from window_runs import rested, run_window


@pytest.mark.parametrize("seed", range(4))
def test_the_newest_node_follows_the_truth(seed):
    rng = np.random.default_rng(seed)
    made = ideal_tracks(seed, hand_held(rng), bias=rng.normal(size=6) * np.repeat([0.05, 0.01], 3))
    window, _ = run_window(made)
    node = window.newest
    true = made.motion.pose(node.time)
    assert window.recoveries == []
    assert error_of(node.state.pose(), true) < 0.01  # 12 lines of 0.5 px over 0.3 m of motion
    np.testing.assert_allclose(node.state.velocity(), made.motion.velocity(node.time), atol=0.03)
    pose, velocity, bias = node.covariances
    for covariance in (pose, velocity, bias):
        assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    assert len(window.lines) == 12


def test_intervals_leave_after_the_lag_with_all_their_frames():
    made = ideal_tracks(0, hand_held(np.random.default_rng(0)))
    window, left = run_window(
        made, load_config(None, ["window.lag=1", "window.state_interval=0.1"])
    )
    kept = [stamp for interval in window.intervals for stamp in interval.stamps]
    gone = [stamp for interval in left for stamp in interval.stamps]
    assert gone
    assert gone + kept == made.stamps[1:]
    for interval in left:
        for stamp, pose in zip(interval.stamps, interval.poses(), strict=True):
            assert error_of(pose, made.motion.pose(stamp * 1e-9)) < 0.01


def clipped_run(seed: int) -> tuple[float, list[Interval], IdealTracks]:
    """Error at the end, m, all intervals, and what was seen; the gyroscope is too small."""
    made = ideal_tracks(seed, hand_held(np.random.default_rng(seed)))
    samples, made.imu = made.imu.between(0.0, made.times[-1]), ImuBuffer()
    end = 0.7 * np.abs(samples.gyroscope).max(axis=0).min()
    # All axes have been at their ends before.
    for time in np.arange(-1.0, -0.001, 0.005).tolist():
        swing = 2.0 * end * np.sin(2 * np.pi * (time + np.arange(3) / 3.0))
        made.imu.append(time, np.clip(swing, -end, end), np.array([time, 0.0, 9.81]))
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        made.imu.append(time, np.clip(w, -end, end), f)
    window, left = run_window(made)
    error = error_of(window.newest.state.pose(), made.motion.pose(window.newest.time))
    return error, [*left, *window.intervals], made


def test_states_of_clipped_intervals_share_a_frame(monkeypatch):
    errors, without = [], []
    for seed in range(4):
        error, intervals, made = clipped_run(seed)
        errors.append(error)
        for before, after in pairwise(intervals):
            assert after.repeats_frame == (not before.is_reliable)
            assert (after.stamps[0] == before.stamps[-1]) == after.repeats_frame
            for own in after.observations:
                seen = after.sightings_of(made.tracks[own.line.id - 1])
                assert seen.frames
                assert max(seen.frames) < after.reliable_frames
                assert own.factor.keys()[0] == X(after.node.index)
        assert sum(interval.repeats_frame for interval in intervals) > 3
        with monkeypatch.context() as patch:
            patch.setattr(ImuBuffer, "in_long_dropout", lambda *_: True)
            without.append(clipped_run(seed)[0])
    assert np.median(errors) < 0.03  # three times what is allowed of one that is not clipped
    assert np.median(errors) < 0.5 * np.median(without)


def test_a_line_that_does_not_fit_is_retired():
    made = ideal_tracks(2, hand_held(np.random.default_rng(2)))
    liar = made.tracks[0]
    for i, seen in enumerate(liar.sightings):
        if i > 20:  # it slips to another edge, and on
            slip = np.array([0.01, 0.01]) * (i - 20)
            liar.sightings[i] = sighting(seen.stamp, seen.points + slip)
    window, _ = run_window(made)
    assert liar.id not in window.lines
    assert error_of(window.newest.state.pose(), made.motion.pose(window.newest.time)) < 0.02


def test_a_line_of_a_start_that_runs_through_the_camera_does_not_enter():
    made = ideal_tracks(2, hand_held(np.random.default_rng(2)))
    start, track = start_of(made), made.tracks[0]
    chart = LineChart(start.state.pose(), np.eye(3), 0.5 * np.pi)
    window = Window(
        CALIBRATION, Config(), replace(start, lines={track.id: InitialLine(chart, np.eye(4))})
    )
    window.extend(frame_times(made.stamps[1:4], made.times[1:4]), made.imu, [track], False)
    assert window.line_manager.take_rejected() == {track.id}
    assert track.id not in window.lines


def test_of_a_line_that_turns_round_nothing_but_a_prior_stays():
    window, _ = run_window(ideal_tracks(2, hand_held(np.random.default_rng(2))))
    smoother, line = window._solver._smoother, next(iter(window.lines.values()))
    before = len(_factors_on(smoother, line.key))
    line.delta = np.array([0.0, 0.0, 1.6, 0.0])  # over a quarter turn: no line does that
    window.line_manager.check_fit(window.intervals[-1])
    assert window.line_manager.take_rejected() == {line.id}
    window.optimize()
    left = _factors_on(smoother, line.key)
    assert before > 5
    assert not any(isinstance(factor, gtsam.CustomFactor) for factor in left)
    assert any(isinstance(factor, gtsam.PriorFactorVector) for factor in left)
    # The others stay.
    assert all(len(_factors_on(smoother, other.key)) > 1 for other in window.lines.values())
    assert not window.recoveries


def _factors_on(smoother: FixedLagSmoother, key: int) -> list[gtsam.NonlinearFactor]:
    graph = smoother._smoother.getFactors()
    factors = [graph.at(i) for i in range(graph.size())]
    return [f for f in factors if f is not None and key in f.keys()]  # noqa: SIM118


def test_a_robust_loss_carries_a_line_that_slips():
    """The ablation in small: without it the same slip pulls the estimate along."""
    errors = {}
    for robust in ("1", "0"):
        made = ideal_tracks(2, hand_held(np.random.default_rng(2)))
        for track in made.tracks[:3]:
            for i, seen in enumerate(track.sightings):
                if i > 40:
                    moved = seen.points + np.array([0.03, -0.03])
                    track.sightings[i] = sighting(seen.stamp, moved)
        window, _ = run_window(made, load_config(None, [f"lines.cauchy_scale_px={robust}"]))
        node = window.newest
        errors[robust] = error_of(node.state.pose(), made.motion.pose(node.time))
    assert errors["1"] < 0.01
    assert errors["1"] < errors["0"]


def test_still_nodes_have_no_velocity():
    window = rested(4)
    # Rest is known of the middle of the time that it was seen; after it the IMU drifts.
    assert np.linalg.norm(window.nodes[-3].state.velocity()) < 0.005
    assert np.linalg.norm(window.newest.state.velocity()) < 0.02


def test_a_body_at_rest_stays_where_it_is():
    window = rested(15)
    first, middle = window.nodes[0], window.nodes[-2]
    assert first.index > 0
    assert error_of(middle.state.pose(), first.state.pose()) < 0.001
    # Held by the first state of the rest in the window, which moves on with it.
    deviations = np.sqrt(np.diag(middle.covariances[0])[3:])
    assert np.all(deviations < 0.003)


def test_lines_that_moved_from_their_linearisation_get_new_variables():
    """All lines are re-anchored, again and again, and nothing of the estimate is lost."""
    made = ideal_tracks(1, hand_held(np.random.default_rng(1)))
    never, often = (
        load_config(None, ["window.lag=1", f"lines.recentre_change={change}"])
        for change in (1000, 1e-4)
    )
    plain, _ = run_window(made, never)
    assert all(line.key <= L(11) for line in plain.lines.values())
    window, _ = run_window(made, often)
    assert window.recoveries == []
    assert all(line.key > L(11) for line in window.lines.values())
    assert len(window.lines) == 12
    # Linearised elsewhere, the same to a part of the few mm that the estimate is off.
    assert error_of(window.newest.state.pose(), plain.newest.state.pose()) < 2e-3
    for line in window.lines.values():
        for end in MANY[line.id - 1]:
            assert line.chart.distance_to(line.delta, end)[0] < 0.03
    # Each of the window's images counts once.
    graph = window._solver._smoother.factors
    factors = [graph.at(i) for i in range(graph.size())]
    held = [id(f) for f in factors if isinstance(f, RuledSurfaceFactor)]
    seen = [id(own.factor) for i in window.intervals for own in i.observations if own.in_graph]
    assert sorted(held) == sorted(seen)


@pytest.mark.parametrize("seed", range(3))
def test_lines_that_rested_find_their_depth_when_the_camera_moves(seed):
    """The smoother fixed their linearisation while nothing was known of their distance."""
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 4.4, 23)
    # Rest for 2.4 s; the spline's ringing is below 4 mm/s until 1.2 s.
    there = np.repeat(rng.normal(scale=0.25, size=(5, 3)), 2, axis=0)
    places = np.concatenate([np.zeros((13, 3)), there])
    motion = SplineMotion(times, places, np.tile([0.1, -0.2, 0.3], (23, 1)))
    made = ideal_tracks(seed, motion, duration=4.0)
    window, _ = run_window(made, still_until=1.4)
    assert window.recoveries == []
    assert len(window.lines) >= 10
    # A metre of motion; 3 mm is what the resting phase leaves open of velocity and tilt.
    assert error_of(window.newest.state.pose(), motion.pose(window.newest.time)) < 0.005
    off = [
        line.chart.distance_to(line.delta, end)[0]
        for line in window.lines.values()
        for end in MANY[line.id - 1]
    ]
    # A line that the camera moved along is known least.
    assert np.median(off) < 0.04
    assert max(off) < 0.15


def test_new_lines_say_next_to_nothing_of_place_and_heading():
    """Else both would seem better known with every line that comes."""
    made = ideal_tracks(1, hand_held(np.random.default_rng(1)))
    window, _ = run_window(made, Config())
    step = 1e-4
    for interval in window.intervals:
        for seen in interval.observations:
            state, line = interval.state(seen.line.delta), seen.line
            pose, keys = gtsam.Pose3(state.world_T_body), seen.factor.spec.keys
            values = gtsam.Values()
            values.insert(keys[0], pose)
            values.insert(keys[1], state.velocity)
            values.insert(keys[2], interval.node.bias)
            values.insert(keys[3], line.delta)
            # Turned about the vertical and shifted, all together.
            moves = [gtsam.Pose3(gtsam.Rot3.Yaw(step), np.zeros(3))]
            moves += [gtsam.Pose3(gtsam.Rot3(), shift) for shift in step * np.eye(3)]
            changes = [
                {
                    keys[0]: pose.localCoordinates(moved * pose),
                    keys[1]: moved.rotation().rotate(state.velocity) - state.velocity,
                    keys[2]: np.zeros(6),
                    keys[3]: _moved(line, moved) - line.delta,
                }
                for moved in moves
            ]
            information = np.zeros((4, 4))
            for factor in new_line_factors(interval.node, line, Config().lines, 3.0):
                linear = factor.linearize(values)
                order = linear.keys()
                by_all = [np.concatenate([change[key] for key in order]) for change in changes]
                jacobian = linear.jacobian()[0] @ np.stack(by_all, axis=1) / step
                information += jacobian.T @ jacobian
            # A prior on the chart alone says up to 1 / rad^2; of the linear one remains what the
            # line has moved from its reference.
            assert np.trace(information) < 0.05


def _moved(line: Landmark, by: gtsam.Pose3) -> np.ndarray:
    moment, direction = np.split(line.plucker[0], 2)
    direction = by.rotation().rotate(direction)
    moment = by.rotation().rotate(moment) + np.cross(by.translation(), direction)
    return line.chart.local(moment, direction)
