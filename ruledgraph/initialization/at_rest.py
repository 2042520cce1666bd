# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A start at rest: gravity and the gyroscope's bias from means."""

import gtsam
import numpy as np
from scipy.linalg import block_diag

from ruledgraph.backend.start import Start
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.prior import Refusal, pose_covariance
from ruledgraph_factors import level_attitude
from ruledgraph_factors.so3 import hat


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
    attitude, of_gravity = level_attitude(force), gravity * force / np.linalg.norm(force)
    return Start(
        stamp=stamp,
        time=stop,
        state=gtsam.NavState(attitude, np.zeros(3), np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(force - of_gravity, samples.gyroscope.mean(axis=0)),
        covariance=_covariance(attitude, of_gravity, config),
        lines={},
        time_offset=time_offset,
    )


def _covariance(attitude: gtsam.Rot3, of_gravity: FloatArray, config: Config) -> FloatArray:
    """Of pose, velocity and bias, (15, 15).

    The mean specific force is that of gravity, f, and the accelerometer's bias b together. Where
    the tilt is off by theta, in the body's axes, b is off by

        theta x f,    and by a change of velocity that the rest may hide, over its duration.
    """
    start, gravity = config.start, config.imu.gravity
    pose = pose_covariance(attitude, start.accelerometer_bias / gravity)
    velocity = start.rest_velocity_sigma**2 * np.eye(3)
    hidden = 2.0 * velocity / config.rest.duration**2
    by_tilt = -hat(of_gravity)
    of_accelerometer = by_tilt @ pose[:3, :3] @ by_tilt.T + hidden
    of_gyroscope = start.rest_gyroscope_sigma**2 * np.eye(3)
    covariance = block_diag(pose, velocity, of_accelerometer, of_gyroscope)
    covariance[9:12, :3] = by_tilt @ pose[:3, :3]
    covariance[:3, 9:12] = covariance[9:12, :3].T
    return np.asarray(covariance)
