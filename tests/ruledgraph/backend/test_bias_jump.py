# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Jumps of the IMU's biases, as lines show them."""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

from ideal_tracks import (
    CALIBRATION,
    IdealTracks,
    error_of,
    frame_times,
    ideal_tracks,
    stamp_of,
    start_of,
)
from ruledgraph.backend.bias_jump import JUMP_DOF, bias_jump
from ruledgraph.backend.line_factors import EdgeModel
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import Extrinsics, FocalRatio
from ruledgraph.core.config import Config
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph.imu.buffer import ImuBuffer
from simulated_window import hand_held

ONSET = 0.8
"""When biases jump, s: right after a state."""
ON_TRIAL = 0.5
"""Until then nothing jumps, s: lines are placed by one state alone."""
FRAMES = 6
"""Of a state, at 30 Hz."""
CONFIDENCE = 0.9999
LIMIT = float(chi2.ppf(CONFIDENCE, JUMP_DOF))
IDEAL = Config.model_validate(
    {"imu": {"accelerometer_scale_sigma": 0.0}, "edges": {"variance_prior": 1e9}}
)
"""The IMU of the tracks has no errors but its noise and biases, and edges are as noisy as said."""


def made_of(seed: int, jump: FloatArray) -> IdealTracks:
    """Tracks, and an IMU whose biases, accelerometer first, jump by so much."""
    made = ideal_tracks(seed, hand_held(np.random.default_rng(seed)), duration=1.7)
    samples, felt = made.imu.between(0.0, 1.7), ImuBuffer()
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        on = time > ONSET
        felt.append(time, w + on * jump[3:], f + on * jump[:3])
    return replace(made, imu=felt)


def seen_as(track: LineTrack, sightings: Iterable[Sighting]) -> LineTrack:
    return track._replace(sightings=deque(sightings))


def run(
    made: IdealTracks, limit: float, config: Config | None = None, solved_until: float = np.inf
) -> tuple[Window, list[float]]:
    """The window at the end, and times of the states at which biases jumped."""
    window = Window(CALIBRATION, config or IDEAL, start_of(made))
    jumped = []
    for first in range(1, len(made.stamps) - FRAMES + 1, FRAMES):
        part = slice(first, first + FRAMES)
        times = made.times[part].tolist()
        own_limit = limit if times[0] > ON_TRIAL else np.inf
        stamps, tracks = made.stamps[part], made.tracks
        window.extend(
            frame_times(stamps, times), made.imu, tracks, still=False, jump_threshold=own_limit
        )
        if times[-1] < solved_until:
            window.optimize()
        test = window.jump_test
        jumped += [window.newest.time] if test is not None and test.jumped else []
    return window, jumped


def test_by_chance_it_finds_none() -> None:
    """Chi-square of six degrees of freedom at most, of 60 states over 10 motions."""
    limit = float(chi2.ppf(0.95, JUMP_DOF))
    found = [time for seed in range(10) for time in run(made_of(seed, np.zeros(6)), limit)[1]]
    # Three with a deviation of 1.7, if it were exact.
    assert len(found) <= 8


def test_variables_of_the_camera_that_are_known_make_no_difference() -> None:
    """Likelihood ratios without a jump, of three motions; the newest lines' derivatives count."""
    for seed in range(3):
        ratios = []
        for camera in (None, Extrinsics(CALIBRATION.body_T_cam, 1e-14 * np.eye(6))):
            ratio = camera and FocalRatio(1.0, 1e-7)
            made = made_of(seed, np.zeros(6))
            window = Window(CALIBRATION, IDEAL, start_of(made), 0.0, camera, ratio)
            ratios.append([])
            for first in range(1, len(made.stamps) - FRAMES + 1, FRAMES):
                part = slice(first, first + FRAMES)
                times = made.times[part].tolist()
                window.extend(
                    frame_times(made.stamps[part], times), made.imu, made.tracks, still=False
                )
                ratios[-1] += [window.jump_test.ratio] if window.jump_test else []
                window.optimize()
        assert len(ratios[0]) > 3
        np.testing.assert_allclose(ratios[1], ratios[0], rtol=0.05, atol=0.1)


@pytest.mark.parametrize(
    "jump",
    [
        [0.0, 0.5, 0, 0, 0, 0],
        [0.3, 0, -0.3, 0, 0, 0],
        [0, 0, 0, 0.03, 0, -0.03],
        [2.0, 0, 0, 0.3, 0, 0],  # three times their deviations before a start
    ],
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_jump_is_found_where_it_is_and_taken_up(jump: list[float], seed: int) -> None:
    made = made_of(seed, np.array(jump))
    without, _ = run(made, np.inf)
    window, jumped = run(made, LIMIT)
    assert jumped == [pytest.approx(ONSET + 0.2, abs=0.01)]
    newest, true = window.newest, made.motion.pose(window.newest.time)
    assert error_of(newest.state.pose(), true) < 0.5 * error_of(without.newest.state.pose(), true)
    # Attitude and both biases to their own covariance, five sigma in any direction.
    turned = gtsam.Rot3.Logmap(true.rotation().between(newest.state.attitude()))
    error = np.concatenate([turned, newest.bias.vector() - jump])
    rows = np.r_[0:3, 9:15]
    nees = error @ np.linalg.solve(newest.covariance[np.ix_(rows, rows)], error)
    assert nees < chi2.ppf(1.0 - 6e-7, 9)


def test_the_imu_leaves_open_what_a_jump_may_be() -> None:
    """A mean that is off by s, and a bias that walks by s in T: s^2 (T^2 + T^2 / 3)."""
    made = made_of(0, np.array([0.0, 0.5, 0, 0, 0, 0]))
    window, jumped = run(replace(made, times=made.times[made.times < ONSET + 0.22]), LIMIT)
    assert len(jumped) == 1
    interval = window.intervals[-1]
    # Rotation, position, velocity, biases.
    covariance = np.linalg.inv(interval.imu_factor.noiseModel().information())
    share = 4.0 / 3.0 * (window.newest.time - interval.node.time) ** 2
    np.testing.assert_allclose(np.diag(covariance)[:3], 0.1**2 * share, rtol=0.05)
    # Horizontally the tilt adds to it.
    along_gravity = np.linalg.eigvalsh(covariance[6:9, 6:9])[0]
    assert along_gravity == pytest.approx(0.3**2 * share, rel=0.05)
    np.testing.assert_allclose(np.diag(covariance)[9:12], 0.3**2, rtol=0.05)
    np.testing.assert_allclose(np.diag(covariance)[12:15], 0.1**2, rtol=0.05)


def test_while_it_is_in_the_window_innovations_tell_nothing() -> None:
    config = Config.model_validate({"window": {"lag": 0.85, "state_interval": 0.2}})
    made = made_of(0, np.array([0.0, 0.5, 0, 0, 0, 0]))
    told = {}
    for until in made.times[1 + FRAMES :: FRAMES].tolist():
        part = replace(made, times=made.times[made.times < until])
        window, _ = run(part, LIMIT, config)
        told[window.newest.time] = window.innovation
    silent = [time for time, found in told.items() if found is None and time > ON_TRIAL]
    assert silent == pytest.approx([1.0, 1.2, 1.4, 1.6], abs=0.01)


def test_with_a_quadratic_loss_it_is_the_ratio_of_two_gaussians() -> None:
    """Residuals r ~ N(0, S), S = R + H P H^T: the ratio is r^T (S^-1 - S'^-1) r, the error of the
    state -P' H^T S'^-1 r.
    """
    made = made_of(1, np.array([0.3, 0, 0, 0, 0, 0]))
    window, _ = run(made, np.inf)
    interval = window.intervals[-1]
    config = Config.model_validate({"lines": {"cauchy_scale_px": 0.0}})
    model = EdgeModel.of(CALIBRATION, config)
    P = interval.node.covariance
    jumped = P + block_diag(np.zeros((9, 9)), 0.3**2 * np.eye(3), 0.1**2 * np.eye(3))
    r, H, R = [], [], []
    for seen in interval.observations:
        found = seen.factor.evaluate(interval.state(seen.line.delta), True)
        assert found.jacobian is not None
        r.append(found.value)
        H.append(found.jacobian[:, :15])
        by_line, variance = found.jacobian[:, -4:], model.sigma**2 / seen.line.weight
        R.append(by_line @ seen.line.covariance @ by_line.T + np.eye(len(by_line)) * variance)
    value, jacobian, noise = np.concatenate(r), np.concatenate(H), block_diag(*R)
    of_none, of_jump = (noise + jacobian @ each @ jacobian.T for each in (P, jumped))
    ratio = value @ (np.linalg.solve(of_none, value) - np.linalg.solve(of_jump, value))
    expected = -jumped @ jacobian.T @ np.linalg.solve(of_jump, value)
    found_jump = bias_jump(interval, interval.observations, model, ratio * 1.001, config)
    assert found_jump is not None
    assert found_jump.ratio == pytest.approx(ratio, rel=1e-6)
    np.testing.assert_allclose(found_jump.jump, expected[9:], rtol=1e-3, atol=1e-5)
    assert not found_jump.jumped
    found_jump = bias_jump(interval, interval.observations, model, ratio * 0.999, config)
    assert found_jump is not None
    assert found_jump.jumped


def test_few_lines_and_those_of_unknown_distance_say_nothing() -> None:
    """Four agree by chance once in sixteen times."""
    made = made_of(1, np.array([2.0, 0, 0, 0, 0, 0]))
    window, _ = run(replace(made, times=made.times[made.times < ONSET + 0.22]), np.inf)
    interval, model = window.intervals[-1], EdgeModel.of(CALIBRATION, Config())
    for count in (4, 12):
        found = bias_jump(interval, interval.observations[:count], model, 0.0, Config())
        assert found is not None
        assert found.ratio > 56.0  # twice the chi-square that chance exceeds in 1 of 10,000
        assert found.jumped == (count == 12)
    for seen in interval.observations:
        inverse, sigma = seen.line.inverse_distance()
        seen.line.covariance = seen.line.covariance * (0.4 * inverse / sigma) ** 2
    assert bias_jump(interval, interval.observations, model, 0.0, Config()) is None


def test_lines_that_a_jump_does_not_explain_say_nothing() -> None:
    """Each one moves on its own by some pixels: the ratio is large, but not for a jump."""
    rng = np.random.default_rng(4)
    made = made_of(1, np.zeros(6))
    tracks = []
    for track in made.tracks:
        x, y = rng.normal(scale=5.0 / CALIBRATION.camera.fx, size=2)
        moved = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
        late = [s.stamp > stamp_of(1.0) for s in track.sightings]
        sightings = (
            s._replace(statistics=np.linalg.qr(s.statistics @ moved.T, mode="r")) if is_late else s
            for s, is_late in zip(track.sightings, late, strict=True)
        )
        tracks.append(seen_as(track, sightings))
    moved_once = replace(made, tracks=tracks, times=made.times[made.times < 1.22])
    window, jumped = run(moved_once, LIMIT)
    assert window.jump_test is not None
    assert window.jump_test.ratio > LIMIT
    assert not jumped
    assert not run(replace(made, tracks=tracks), LIMIT)[1]


def test_a_jump_after_a_state_that_was_not_solved_for_is_found() -> None:
    """As at rest, where the window is solved now and then."""
    _, jumped = run(made_of(0, np.array([0.0, 0.5, 0, 0, 0, 0])), LIMIT, solved_until=0.7)
    assert jumped[0] == pytest.approx(ONSET + 0.2, abs=0.01)


def test_a_jump_that_an_innovation_has_shown_needs_no_ratio() -> None:
    """Of a gyroscope's bias that grows by 0.2 rad/s^2 the ratio shows too little at some states."""
    still = made_of(2, np.zeros(6))
    samples, felt = still.imu.between(0.0, 1.7), ImuBuffer()
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        felt.append(time, w + np.array([0.2 * max(time - ONSET, 0.0), 0.0, 0.0]), f)
    drifting = replace(still, imu=felt)
    without, _ = run(drifting, np.inf)
    window, jumped = run(drifting, -np.inf)
    assert len(jumped) > len(run(drifting, LIMIT)[1]) > 0
    true = still.motion.pose(window.newest.time)
    errors = [error_of(one.newest.state.pose(), true) for one in (window, without)]
    assert errors[0] < 0.5 * errors[1]
    # Lines tell of the bias before an interval: it is known as of two states ago.
    bias = 0.2 * (window.newest.time - 0.4 - ONSET)
    assert window.newest.bias.gyroscope()[0] == pytest.approx(bias, abs=0.03)


def test_without_lines_or_a_covariance_there_is_none() -> None:
    window, _ = run(made_of(0, np.zeros(6)), np.inf)
    interval, model = window.intervals[-1], EdgeModel.of(CALIBRATION, Config())
    assert bias_jump(interval, [], model, -np.inf, Config()) is None
    interval.node.covariance = -np.eye(15)
    assert bias_jump(interval, interval.observations, model, 0.0, Config()) is None
