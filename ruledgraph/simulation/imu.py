# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated IMU on a moving body."""

from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph.sensors import ImuNoise
from ruledgraph.simulation.motion import FloatArray, SplineMotion
from ruledgraph_factors import STANDARD_GRAVITY, ImuSamples


@dataclass(frozen=True, eq=False)
class SimulatedImu:
    """Samples and the bias they carry."""

    samples: ImuSamples
    bias: FloatArray
    """Accelerometer and gyroscope bias at every sample, (N, 6)."""

    def bias_at(self, time: float) -> gtsam.imuBias.ConstantBias:
        """The true bias at one time."""
        columns = [np.interp(time, self.samples.times, column) for column in self.bias.T]
        return gtsam.imuBias.ConstantBias(np.array(columns[:3]), np.array(columns[3:]))


def simulate_imu(
    motion: SplineMotion,
    rate: float,
    noise: ImuNoise | None,
    rng: np.random.Generator,
    initial_bias: FloatArray | None = None,
) -> SimulatedImu:
    """Sample an IMU over the whole motion.

    Gyroscope: w + b_g + noise; accelerometer: R^T (a - g) + b_a + noise; both biases walk.

    Args:
        motion: world_T_body(t).
        rate: Hz.
        noise: None for none (the bias then stays constant).
        rng: source of all randomness.
        initial_bias: accelerometer (m/s^2) and gyroscope (rad/s), (6,), by default zero.
    """
    count = int(np.floor((motion.stop - motion.start) * rate)) + 1
    times = motion.start + np.arange(count) / rate
    body_R_world = np.swapaxes(motion.rotation(times), -1, -2)
    force = motion.acceleration(times) - np.array(STANDARD_GRAVITY)
    ideal = np.hstack(
        [np.einsum("nij,nj->ni", body_R_world, force), motion.angular_velocity(times)]
    )
    bias = np.tile(np.zeros(6) if initial_bias is None else initial_bias, (count, 1))
    white = np.zeros_like(ideal)
    if noise is not None:
        density = np.repeat([noise.accelerometer, noise.gyroscope], 3)
        walk = np.repeat([noise.accelerometer_walk, noise.gyroscope_walk], 3)
        white = rng.normal(size=(count, 6)) * density * np.sqrt(rate)
        steps = rng.normal(size=(count - 1, 6)) * walk / np.sqrt(rate)
        bias[1:] += np.cumsum(steps, axis=0)
    measured = ideal + bias + white
    return SimulatedImu(ImuSamples(times, measured[:, 3:], measured[:, :3]), bias)
