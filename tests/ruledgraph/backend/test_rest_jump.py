# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Jumps of the IMU's biases while the body rests."""

import gtsam
import numpy as np
import pytest
from scipy.optimize import minimize

from ideal_tracks import (
    CALIBRATION,
    IdealTracks,
    at_rest,
    error_of,
    frame_times,
    ideal_tracks,
    start_of,
)
from ruledgraph.backend.rest_jump import rest_jump
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import propagated_covariances

STEP = 6
"""Frames of a state, at 30 Hz."""
DURATION = 4.5
ONSET = 2.4
LIMIT = 1e9
"""That no ratio of lines reaches: only the rest shows a jump."""
CONFIG = Config()


def lifted(seed: int, acceleration: FloatArray) -> IdealTracks:
    """Of a body that rests, and whose accelerometer shows so much more from the onset on."""
    made = ideal_tracks(seed, at_rest(DURATION), duration=DURATION)
    samples, felt = made.imu.between(0.0, DURATION), ImuBuffer()
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        felt.append(time, w, f + (time > ONSET) * acceleration)
    made.imu = felt
    return made


def run(made: IdealTracks, limit: float, until: float = DURATION) -> tuple[Window, list[float]]:
    """The window, and the times of the states at which biases jumped."""
    window, jumped = Window(CALIBRATION, CONFIG, start_of(made)), []
    for first in range(1, len(made.times) - STEP, STEP):
        times = made.times[first : first + STEP].tolist()
        if times[-1] > until:
            break
        stamps, tracks = made.stamps[first : first + STEP], made.tracks
        window.extend(
            frame_times(stamps, times), made.imu, tracks, still=True, jump_threshold=limit
        )
        window.optimize()
        jumped += [window.newest.time] if window.jumped else []
    return window, jumped


def test_at_rest_nothing_jumps_by_chance():
    for seed in range(4):
        assert not run(lifted(seed, np.zeros(3)), LIMIT)[1]


def test_nothing_jumps_where_the_limit_says_so():
    assert not run(lifted(0, np.array([0.0, 0.0, 1.0])), np.inf)[1]


@pytest.mark.parametrize("acceleration", [0.3, -0.5, 1.0])
def test_the_biases_follow_a_lift_and_the_body_stays(acceleration):
    made = lifted(1, np.array([0.0, 0.0, acceleration]))
    window, jumped = run(made, LIMIT)
    assert jumped
    assert ONSET < jumped[0] < ONSET + 0.4
    assert all(time < ONSET + 1.0 for time in jumped)
    # Without the jump the velocity of the last frames of a state is off by what 0.2 s make of it.
    assert np.linalg.norm(window.newest.state.velocity()) < 0.01
    assert error_of(window.newest.state.pose(), made.motion.pose(DURATION)) < 0.01
    assert abs(window.newest.bias.accelerometer()[2] - acceleration) < 0.1 + 0.1 * abs(acceleration)


def test_ratio_and_jump_are_those_of_the_likelihoods():
    """By minimising over the jump numerically; the state's velocity, wrong or not, says nothing."""
    made = lifted(2, np.array([0.2, -0.1, 0.4]))
    window, _ = run(made, np.inf, until=ONSET + 0.3)
    interval = window.intervals[-1]
    noise, node = CALIBRATION.imu_noise, interval.node
    test = rest_jump(interval, made.imu, noise, CONFIG)
    assert test is not None
    motion = interval.motion.select([-1])
    known = node.covariance.copy()
    known[6:9], known[:, 6:9] = 0.0, 0.0
    node.covariance = known
    S = propagated_covariances(node, motion, made.imu, noise)[0, 6:9, 6:9]
    S = S + 2.0 * CONFIG.rest.velocity_sigma**2 * np.eye(3)
    sigmas = CONFIG.start.bias_sigmas

    def cost(scaled: FloatArray) -> float:
        changed = type(node.bias)(*np.split(node.bias.vector() + scaled * sigmas, 2))
        change = motion.velocities(node.state, changed, made.imu.gravity)[0] - node.state.velocity()
        return float(change @ np.linalg.solve(S, change) + scaled @ scaled)

    best = minimize(cost, np.zeros(6), method="BFGS")
    # The prediction is linear in a bias but for the turn by the gyroscope's, of 20 mrad.
    assert test.ratio == pytest.approx(cost(np.zeros(6)) - best.fun, rel=0.02)
    assert np.allclose(test.jump, best.x * sigmas, atol=0.02 * np.abs(test.jump).max())
    faster = node.state.velocity() + np.array([0.2, 0.0, -0.1])
    node.state = gtsam.NavState(node.state.pose(), faster)
    moving = rest_jump(interval, made.imu, noise, CONFIG)
    assert moving is not None
    assert moving.ratio == pytest.approx(test.ratio)


def test_without_a_covariance_there_is_no_test():
    made = lifted(0, np.array([0.0, 0.0, 0.5]))
    window, _ = run(made, np.inf, until=ONSET + 0.3)
    interval = window.intervals[-1]
    interval.node.covariance = -np.eye(15)
    assert rest_jump(interval, made.imu, CALIBRATION.imu_noise, CONFIG) is None
