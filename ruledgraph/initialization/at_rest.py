# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A start at rest: gravity and the gyroscope's bias from means."""

from collections.abc import Callable

import gtsam
import numpy as np

from ruledgraph.backend.states import Start
from ruledgraph.core.config import Config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.prior import Refusal, level, pose_covariance, unknown_offset
from ruledgraph_factors import STANDARD_GRAVITY

_G = -STANDARD_GRAVITY[2]
# At rest the gyroscope and the accelerometer hardly vary (rad/s, m/s^2), and the image does not
# move (px).
_STILL_GYROSCOPE, _STILL_ACCELEROMETER, _STILL_IMAGE = 0.02, 0.25, 0.4
# The specific force at rest is the Earth's gravity to this share; in g, or without, it is not.
_GRAVITY_SHARE = 0.15
# Of a body that rests: velocity (m/s) and, of a mean over some tenths of a second, gyroscope
# (rad/s).
_VELOCITY_SIGMA, _GYROSCOPE_SIGMA = 0.01, 2e-3


def is_still(imu: ImuBuffer, start: float, stop: float, image_motion: Callable[[], float]) -> bool:
    """Whether body and image rest over [start, stop].

    Args:
        imu: samples that cover it.
        start: s.
        stop: s.
        image_motion: of the lines from start to stop, px, see `Tracker.image_motion`; asked for
            only where the IMU is still.
    """
    samples = imu.between(start, stop)
    return bool(
        samples.gyroscope.std(axis=0).max() < _STILL_GYROSCOPE
        and samples.accelerometer.std(axis=0).max() < _STILL_ACCELEROMETER
        and image_motion() < _STILL_IMAGE
    )


def start_at_rest(
    imu: ImuBuffer, stamp: int, start: float, stop: float, config: Config
) -> Start | Refusal:
    """Gravity from the mean specific force, gyroscope bias from the mean rate.

    Args:
        imu: samples that cover the rest.
        stamp: of the frame at its end, where the window begins, ns.
        start: of the rest, s.
        stop: of the rest, s.
        config: all settings.
    """
    samples = imu.between(start, stop)
    force = samples.accelerometer.mean(axis=0)
    if abs(np.linalg.norm(force) - _G) > _GRAVITY_SHARE * _G:
        return Refusal(
            f"at rest the accelerometer shows {np.linalg.norm(force):.2f} instead of 9.81 m/s^2"
        )
    a, attitude = config.start.accelerometer_bias, level(force)
    return Start(
        stamp=stamp,
        time=stop,
        state=gtsam.NavState(attitude, np.zeros(3), np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(np.zeros(3), samples.gyroscope.mean(axis=0)),
        # The accelerometer's bias cannot be told from a tilt.
        pose_covariance=pose_covariance(attitude, a / _G),
        velocity_sigma=_VELOCITY_SIGMA,
        bias_sigmas=np.repeat([a, _GYROSCOPE_SIGMA], 3),
        lines={},
        time_offset=unknown_offset(config),
    )
