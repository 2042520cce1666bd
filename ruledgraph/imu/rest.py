# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the IMU can be that of a body at rest."""

import numpy as np
from scipy.integrate import cumulative_trapezoid, trapezoid

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import RestConfig

# Two readings, less their mean, have no integral, whatever they are.
_MIN_READINGS = 3


def imu_rests(times: FloatArray, imu: FloatArray, config: RestConfig) -> bool:
    """Whether velocity and attitude, by the IMU, stay those of a body at rest.

    With the readings' means over time, which at rest are gravity and the biases, taken off:

        v(t) = int_0^t (f - mean f) ds,    theta(t) = int_0^t (w - mean w) ds

    stay within three standard deviations of a resting body's. Noise and the vibration of motors
    change the readings by much, and these by little.

    Args:
        times: of the samples, s, (N,).
        imu: gyroscope (rad/s) and accelerometer (m/s^2), (N, 6).
        config: how much a resting body moves.
    """
    if len(times) < _MIN_READINGS:
        return False
    mean = trapezoid(imu, times, axis=0) / (times[-1] - times[0])
    moved = np.abs(cumulative_trapezoid(imu - mean, times, axis=0))
    sigmas = np.repeat([config.pose_sigma, config.velocity_sigma], 3)
    return bool(np.all(moved < 3.0 * sigmas))
