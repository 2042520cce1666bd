# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A window of made-up tracks with its integrity monitor."""

import numpy as np

from ideal_tracks import CALIBRATION, MANY, frame_times, ideal_tracks, start_of
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.config import Config
from ruledgraph.core.messages import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.integrity.gauge import GaugeUncertainty
from ruledgraph.integrity.monitor import IntegrityMonitor
from simulated_window import BODY_T_CAM, hand_held


def monitored_window(segments=MANY, late: float = 0.0, noise_times: float = 1.0, seed: int = 1):
    """Window and monitor at the end of 1.6 s, and the messages; IMU stamps are `late`."""
    made = ideal_tracks(
        seed, hand_held(np.random.default_rng(seed)), duration=1.6, segments=segments
    )
    if late:
        samples, shifted = made.imu.between(0.0, 1.6), ImuBuffer()
        for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
            shifted.append(time - late, w, f)
        made.imu = shifted
    noise = type(CALIBRATION.imu_noise)(
        *(noise_times * value for value in vars(CALIBRATION.imu_noise).values())
    )
    calibration = type(CALIBRATION)(CALIBRATION.camera, BODY_T_CAM, noise)
    window = Window(calibration, Config(), start_of(made))
    warnings = Messages()
    monitor = IntegrityMonitor(GaugeUncertainty(), warnings, Config())
    stamps, times = made.stamps[1:], made.times[1:].tolist()
    for first in range(0, len(times) - 3, 3):
        part = slice(first, first + 3)
        if times[part][-1] > made.imu.latest:
            break
        window.extend(frame_times(stamps[part], times[part]), made.imu, made.tracks, False)
        window.optimize()
        monitor.update(window, False)
    return window, monitor, warnings
