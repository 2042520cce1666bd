# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated IMU on a moving body."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.sensors import ImuNoise
from ruledgraph.simulation.motion import FloatArray, Motion
from ruledgraph_factors import STANDARD_GRAVITY, ImuSamples

# Samples made at a time.
_CHUNK = 1000


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


class ImuChunk(NamedTuple):
    """A few seconds of samples: times (N,), s; gyroscope and accelerometer (N, 3)."""

    times: FloatArray
    gyroscope: FloatArray
    accelerometer: FloatArray


def simulate_imu(
    motion: Motion,
    rate: float,
    noise: ImuNoise | None,
    rng: np.random.Generator,
    initial_bias: FloatArray | None = None,
) -> SimulatedImu:
    """Sample an IMU over the whole motion, see `stream_imu`.

    Args:
        motion: world_T_body(t).
        rate: Hz.
        noise: None for none (the bias then stays constant).
        rng: source of all randomness.
        initial_bias: accelerometer (m/s^2) and gyroscope (rad/s), (6,), by default zero.
    """
    bias = walk_bias(sample_count(motion, rate), rate, noise, rng, initial_bias)
    chunks = zip(*stream_imu(motion, rate, noise, bias, rng), strict=True)
    return SimulatedImu(ImuSamples(*(np.concatenate(signal) for signal in chunks)), bias)


def sample_count(motion: Motion, rate: float) -> int:
    """How many samples cover the motion, its start and, if one falls there, its stop included."""
    return int(np.floor((motion.stop - motion.start) * rate + 1e-6)) + 1


def walk_bias(
    count: int,
    rate: float,
    noise: ImuNoise | None,
    rng: np.random.Generator,
    initial_bias: FloatArray | None = None,
) -> FloatArray:
    """The bias (accelerometer, gyroscope) at every sample, (count, 6), from its random walk."""
    bias = np.tile(np.zeros(6) if initial_bias is None else initial_bias, (count, 1))
    if noise is not None:
        walk = np.repeat([noise.accelerometer_walk, noise.gyroscope_walk], 3)
        steps = rng.normal(size=(count - 1, 6)) * walk / np.sqrt(rate)
        bias[1:] += np.cumsum(steps, axis=0)
    return bias


def stream_imu(
    motion: Motion,
    rate: float,
    noise: ImuNoise | None,
    bias: FloatArray,
    rng: np.random.Generator,
) -> Iterator[ImuChunk]:
    """Sample an IMU over the whole motion, some seconds at a time.

    Gyroscope: w + b_g + noise; accelerometer: R^T (a - g) + b_a + noise.

    Args:
        motion: world_T_body(t).
        rate: Hz.
        noise: None for none.
        bias: at every sample, see `walk_bias`.
        rng: source of the white noise.
    """
    for first in range(0, len(bias), _CHUNK):
        bias_here = bias[first : first + _CHUNK]
        times = motion.start + np.arange(first, first + len(bias_here)) / rate
        body_R_world = np.swapaxes(motion.rotation(times), -1, -2)
        force = motion.acceleration(times) - np.array(STANDARD_GRAVITY)
        measured = bias_here + np.hstack(
            [np.einsum("nij,nj->ni", body_R_world, force), motion.angular_velocity(times)]
        )
        if noise is not None:
            density = np.repeat([noise.accelerometer, noise.gyroscope], 3)
            measured += rng.normal(size=measured.shape) * density * np.sqrt(rate)
        yield ImuChunk(times, measured[:, 3:], measured[:, :3])
