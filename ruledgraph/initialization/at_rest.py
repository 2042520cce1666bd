# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A start at rest: gravity and the gyroscope's bias from means."""

import gtsam
import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.core.config import Config
from ruledgraph.core.time_offset import TimeOffset
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.prior import Refusal, pose_covariance
from ruledgraph_factors import level_attitude


def start_at_rest(
    imu: ImuBuffer,
    stamp: int,
    start: float,
    stop: float,
    config: Config,
    time_offset: TimeOffset | None = None,
) -> Start | Refusal:
    """Gravity from the mean specific force, gyroscope bias from the mean rate.

    Args:
        imu: samples that cover the rest.
        stamp: of the frame at its end, where the window begins, ns.
        start: of the rest, s.
        stop: of the rest, s.
        config: all settings.
        time_offset: how much later than its time the frame may have been taken; None: it is known.
    """
    samples = imu.between(start, stop)
    force, gravity = samples.accelerometer.mean(axis=0), config.imu.gravity
    if abs(np.linalg.norm(force) - gravity) > config.start.gravity_share * gravity:
        return Refusal(
            f"at rest the accelerometer shows {np.linalg.norm(force):.2f} instead of "
            f"{gravity:.2f} m/s^2"
        )
    a, attitude = config.start.accelerometer_bias, level_attitude(force)
    return Start(
        stamp=stamp,
        time=stop,
        state=gtsam.NavState(attitude, np.zeros(3), np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(np.zeros(3), samples.gyroscope.mean(axis=0)),
        # The accelerometer's bias cannot be distinguished from a tilt.
        pose_covariance=pose_covariance(attitude, a / gravity),
        velocity_sigma=config.start.rest_velocity_sigma,
        bias_sigmas=np.repeat([a, config.start.rest_gyroscope_sigma], 3),
        lines={},
        time_offset=time_offset,
    )
