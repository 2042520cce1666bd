# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Normalised innovations of states."""

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from ideal_tracks import CALIBRATION, MANY, at_rest, frame_times, ideal_tracks, start_of
from ruledgraph.backend.innovation import innovation
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import StateNode
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Innovation
from ruledgraph.core.settings import load_config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import propagated_covariances
from ruledgraph_factors import preintegrate_frames
from simulated_window import hand_held
from small_runs import run
from small_simulation import new_small_simulation

STATE = gtsam.NavState(
    gtsam.Rot3.RzRyRx(0.3, -0.2, 1.0), np.array([1.0, 2, 3]), np.array([0.4, 0, 1])
)
BIAS = gtsam.imuBias.ConstantBias(np.array([0.1, 0, 0]), np.array([0, 0.01, 0]))


def moved(by: FloatArray, covariance: FloatArray) -> StateNode:
    """STATE and BIAS moved by (rotation, position, velocity, bias), (15,)."""
    pose = STATE.pose().retract(by[:6])
    state = gtsam.NavState(pose, STATE.velocity() + by[6:9])
    bias = gtsam.imuBias.ConstantBias(BIAS.accelerometer() + by[9:12], BIAS.gyroscope() + by[12:])
    return StateNode(1, 0.2, state, bias, covariance)


def kalman(rng: np.random.Generator, rows: int, sigma: float) -> tuple[FloatArray, ...]:
    """A prediction's covariance, and what a measurement makes of it: gain, P and S."""
    root = rng.normal(size=(15, 15)) * np.repeat([1e-3, 1e-3, 1e-2, 1e-2, 1e-4], 3)[:, None]
    before = root @ root.T
    H = rng.normal(size=(rows, 15)) @ np.linalg.inv(np.linalg.cholesky(before))
    S = H @ before @ H.T + sigma**2 * np.eye(rows)
    gain = before @ H.T @ np.linalg.inv(S)
    return before, gain, before - gain @ S @ gain.T, S


@pytest.mark.parametrize("rows", [1, 4, 9])
def test_it_is_that_of_the_measurement(rows: int) -> None:
    """A sharp measurement of fewer rows than the state has: both are the same to rounding."""
    rng = np.random.default_rng(rows)
    before, gain, after, S = kalman(rng, rows, 0.5)
    unexpected = np.linalg.cholesky(S) @ rng.normal(size=rows)
    found = innovation(moved(np.zeros(15), before), moved(gain @ unexpected, after), 0.0)
    assert found.dof == rows
    assert found.nis == pytest.approx(unexpected @ np.linalg.solve(S, unexpected), rel=1e-5)


def test_it_is_chi_square() -> None:
    rng = np.random.default_rng(3)
    before, gain, after, S = kalman(rng, 5, 1.0)
    root, predicted = np.linalg.cholesky(S), moved(np.zeros(15), before)
    steps = (gain @ root @ rng.normal(size=(5, 400))).T
    values = [innovation(predicted, moved(step, after), 0.0).nis for step in steps]
    # The mean of 400 has a standard deviation of 3 % of 5, the shares one of 1 %.
    assert np.mean(values) == pytest.approx(5.0, rel=0.1)
    assert np.mean(np.array(values) > chi2.ppf(0.95, 5)) == pytest.approx(0.05, abs=0.035)


def test_directions_that_are_not_told_do_not_count() -> None:
    """Place and heading: whatever a state moves there says nothing of the noise."""
    before = np.diag(np.repeat([1e-6, 1e-2, 1e-4, 1e-3, 1e-8], 3))
    after = before.copy()
    after[6:9, 6:9] *= 0.2
    step = np.zeros(15)
    step[3:6], step[6:9] = 0.5, 0.01
    found = innovation(moved(np.zeros(15), before), moved(step, after), 0.0)
    assert found.dof == 3
    # 3 (0.01 m/s)^2 over the variance that is gone.
    assert found.nis == pytest.approx(3 * 0.01**2 / 0.8e-4, rel=1e-6)


def test_states_of_a_recording_have_innovations_as_their_noise_figures_say() -> None:
    simulation = new_small_simulation(seed=2, moving=True, duration=5.0)
    _, live, smoothed = run(simulation.stream(), simulation.calibration)
    assert all(e.innovation is None for e in live if not e.at_state)
    assert all(e.innovation is None for e in smoothed)
    found = [e.innovation for e in live if e.innovation is not None]
    assert len(found) > 10
    ratio = sum(i.nis for i in found) / sum(i.dof for i in found)
    # The noise of rendered edges is smaller than assumed; beyond 2 the estimate would be too sure.
    assert 0.05 < ratio < 2.0


def test_a_state_is_compared_with_what_the_imu_makes_of_one_some_time_before() -> None:
    """Here with the IMU integrated anew, in the window by what is kept of its intervals."""
    made = ideal_tracks(1, hand_held(np.random.default_rng(1)), duration=1.6, segments=MANY)
    config = load_config(None, ["integrity.innovation_span=0.85"])
    window = Window(CALIBRATION, config, start_of(made))
    stamps, times = made.stamps[1:], made.times[1:].tolist()
    known = {}
    for first in range(0, 42, 6):
        part = slice(first, first + 6)
        window.extend(frame_times(stamps[part], times[part]), made.imu, made.tracks, False)
        window.optimize()
        newest = window.newest
        known[newest.time] = StateNode(
            newest.index, newest.time, newest.state, newest.bias, newest.covariance.copy()
        )
    # The oldest that is no longer before than the span.
    since = min(time for time in known if newest.time - time <= 0.85)
    assert newest.time - since > 0.6
    predicted = known[since]
    for time in sorted(time for time in known if time > since):
        samples = made.imu.between(predicted.time, time)
        motion = preintegrate_frames(samples, predicted.time, [time], predicted.bias)
        covariance = propagated_covariances(predicted, motion, made.imu, CALIBRATION.imu_noise)[0]
        state, gravity = predicted.state, made.imu.gravity
        carried = gtsam.NavState(
            motion.poses(state, predicted.bias, gravity)[0],
            motion.velocities(state, predicted.bias, gravity)[0],
        )
        predicted = StateNode(0, time, carried, predicted.bias, covariance)
    expected = innovation(predicted, newest, since)
    assert window.innovation is not None
    assert window.innovation.dof == expected.dof
    assert window.innovation.since == since
    assert window.innovation.nis == pytest.approx(expected.nis, rel=0.02)


def test_without_a_covariance_there_is_none() -> None:
    made = ideal_tracks(1, hand_held(np.random.default_rng(1)), duration=1.0, segments=MANY)
    window = Window(CALIBRATION, Config(), start_of(made))
    for first in (0, 4, 8):
        window.newest.covariance = -np.eye(15)
        part = slice(1 + first, 5 + first)
        window.extend(
            frame_times(made.stamps[part], made.times[part]), made.imu, made.tracks, False
        )
        window.optimize()
        assert window.innovation is None


def standing(acceleration: float) -> tuple[Window, list[Innovation | None]]:
    """A window that is solved every 0.4 s, not at each state, before lines that do not move."""
    made = ideal_tracks(1, at_rest(2.8), duration=2.8, segments=MANY)
    samples, felt = made.imu.between(0.0, 2.8), ImuBuffer()
    up = at_rest(2.8).pose(0.0).rotation().unrotate(np.array([0.0, 0.0, 1.0]))
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        felt.append(time, w, f + (acceleration * up if time > 1.0 else 0.0))
    window, found = Window(CALIBRATION, Config(), start_of(made)), []
    for first in range(0, len(made.stamps) - 5, 4):
        part = slice(1 + first, 5 + first)
        window.extend(frame_times(made.stamps[part], made.times[part]), felt, made.tracks, True)
        if first % 8 == 0:
            window.optimize()
            found.append(window.innovation)
        else:
            assert window.innovation is None
    return window, found


def test_at_rest_it_is_that_of_the_rest() -> None:
    _, (first, *found) = standing(0.0)
    assert first is None
    for each in found:
        assert each is not None
        assert each.nis < chi2.ppf(0.999, each.dof)


def test_a_lift_that_starts_is_no_rest() -> None:
    _, (_, *found) = standing(1.0)
    newest = found[-1]
    assert newest is not None
    assert newest.nis > 3.0 * chi2.ppf(0.999, newest.dof)
