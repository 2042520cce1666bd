# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Smoothed estimates of a window across an interval in which the IMU says little."""

import numpy as np
from scipy.stats import chi2

from ideal_tracks import CALIBRATION, frame_times, ideal_tracks, start_of
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.calibration_estimates import NO_OFFSET
from ruledgraph.core.config import Config
from ruledgraph.core.messages import Messages
from ruledgraph.core.output import Output
from ruledgraph.core.settings import load_config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.integrity.gauge import GaugeUncertainty
from ruledgraph.integrity.monitor import IntegrityMonitor
from ruledgraph.segments.reporter import EstimateReporter
from simulated_window import hand_held

ONSET = 0.8
"""When biases jump, s: right after a state."""
FRAMES = 6
"""Of a state, at 30 Hz."""
NO_SCALE_ERRORS = load_config(None, ["imu.accelerometer_scale_sigma=0"])


def test_across_a_jump_of_the_biases_poses_are_as_good_as_they_say():
    """Also that of the state after the jump: from the state before it the IMU is 4 cm off."""
    jump = np.array([2.0, 0.0, 0.0, 0.3, 0.0, 0.0])
    made, felt = ideal_tracks(0, hand_held(np.random.default_rng(0)), duration=1.7), ImuBuffer()
    samples = made.imu.between(0.0, 1.7)
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        on = time > ONSET
        felt.append(time, w + on * jump[3:], f + on * jump[:3])
    window, jumped = Window(CALIBRATION, NO_SCALE_ERRORS, start_of(made)), []
    for first in range(1, len(made.stamps) - FRAMES + 1, FRAMES):
        part = slice(first, first + FRAMES)
        times = made.times[part].tolist()
        limit = float(chi2.ppf(0.9999, 6)) if times[0] > 0.5 else np.inf
        window.extend(
            frame_times(made.stamps[part], times), felt, made.tracks, False, jump_threshold=limit
        )
        window.optimize()
        jumped += [times[-1]] if window.jumped else []
    assert jumped == [window.nodes[5].time]
    window.read_smoothed_covariances()

    output, config = Output(), Config()
    monitor = IntegrityMonitor(GaugeUncertainty(), Messages(), config)
    reporter = EstimateReporter(output, 0, monitor, felt, 0.0, config.lines, hold=False)
    reporter.report_smoothed(window, list(window.intervals), NO_OFFSET)
    found = output.take_smoothed()
    last = window.intervals[-1].stamps[-1]
    assert [e.stamp for e in found] == [s for s in made.stamps if s <= last]
    of_states = [window.first_stamp, *(i.stamps[-1] for i in window.intervals)]
    assert [e.stamp for e in found if e.at_state] == of_states
    errors = []
    for estimate in found:
        error = estimate.world_T_body.localCoordinates(made.motion.pose(estimate.stamp * 1e-9))
        errors.append(error @ np.linalg.solve(estimate.covariances[0], error))
        if estimate.stamp == of_states[5]:
            assert np.linalg.norm(error[3:]) < 5e-3
    assert max(errors) < chi2.ppf(0.9999, 6)
