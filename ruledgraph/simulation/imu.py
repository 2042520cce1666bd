# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU of a simulated recording: simulated on a moving body, or recorded."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import gtsam
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import ImuSample
from ruledgraph.core.text_table import read_table
from ruledgraph.simulation.motion import Motion
from ruledgraph_factors import STANDARD_GRAVITY, ImuSamples

# Samples made at a time.
_CHUNK = 1000
# Deviations of the bias when an IMU is switched on: m/s^2 and rad/s.
_BIAS_SIGMAS = np.repeat([0.08, 0.004], 3)


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


class ImuSource(Protocol):
    """The IMU of a simulated recording."""

    def samples(self) -> Iterator[ImuSample]:
        """All samples, in order; the same each time."""

    def bias_at(self, stamps: NDArray[np.int64]) -> FloatArray:
        """True bias (accelerometer, gyroscope) at stamps (n,), (n, 6)."""


class SyntheticImu:
    """An IMU simulated on a motion while it is read.

    Args:
        motion: world_T_body(t).
        rate: Hz.
        noise: None for an IMU without noise and bias; the bias is otherwise random at first.
        seed: of all randomness.
        epoch: stamp of the motion's time zero, ns.
    """

    def __init__(
        self, motion: Motion, rate: float, noise: ImuNoise | None, seed: int, epoch: int
    ) -> None:
        self._motion, self._rate, self._noise = motion, rate, noise
        self._seed, self._epoch = seed, epoch
        rng = np.random.default_rng([seed, 7])
        initial = None if noise is None else rng.normal(size=6) * _BIAS_SIGMAS
        self._bias = walk_bias(sample_count(motion, rate), rate, noise, rng, initial)

    def samples(self) -> Iterator[ImuSample]:  # noqa: D102
        rng = np.random.default_rng([self._seed, 8])
        for chunk in stream_imu(self._motion, self._rate, self._noise, self._bias, rng):
            stamps = np.round(chunk.times * 1e9).astype(np.int64) + self._epoch
            for sample in zip(stamps.tolist(), chunk.gyroscope, chunk.accelerometer, strict=True):
                yield ImuSample(*sample)

    def bias_at(self, stamps: NDArray[np.int64]) -> FloatArray:  # noqa: D102
        times = np.asarray((stamps - self._epoch) * 1e-9 - self._motion.start, dtype=np.float64)
        return _interpolate(times, np.arange(len(self._bias)) / self._rate, self._bias)


class RecordedImu:
    """The samples of a real IMU that moved along a measured trajectory; its bias is NaN until it is
    given by `with_bias`.

    Args:
        path: EuRoC's imu0/data.csv: stamp (ns), gyroscope, accelerometer.

    Raises:
        RuledgraphError: for files that cannot be read or have other columns.
    """

    def __init__(self, path: str | Path) -> None:
        table = read_table(Path(path))
        if table.width != 7:
            raise RuledgraphError(f"{path}: {table.width} columns, but EuRoC's IMU files have 7")
        self.stamps = table.stamps(0, "ns")
        self._values = table.numbers(range(1, 7))
        self._bias_stamps, self._bias = self.stamps[:1], np.full((1, 6), np.nan)

    def between(self, start: int, stop: int) -> "RecordedImu":
        """Its part between two stamps.

        Raises:
            RuledgraphError: when there are fewer than two samples.
        """
        inside = (self.stamps >= start) & (self.stamps <= stop)
        if np.count_nonzero(inside) < 2:
            raise RuledgraphError(
                f"the recorded IMU ({self.stamps[0]} to {self.stamps[-1]} ns) has no samples "
                f"during the motion ({start} to {stop} ns)"
            )
        part = copy.copy(self)
        part.stamps, part._values = self.stamps[inside], self._values[inside]
        return part

    def integrable(self) -> ImuSamples:
        """All samples, with times from the first one on, s."""
        times = (self.stamps - self.stamps[0]) * 1e-9
        return ImuSamples(times, self._values[:, :3], self._values[:, 3:])

    def with_bias(self, stamps: NDArray[np.int64], bias: FloatArray) -> "RecordedImu":
        """The same with this bias (M, 6), accelerometer and gyroscope, at stamps (M,)."""
        known = copy.copy(self)
        known._bias_stamps, known._bias = stamps, bias
        return known

    def samples(self) -> Iterator[ImuSample]:  # noqa: D102
        for stamp, values in zip(self.stamps.tolist(), self._values, strict=True):
            yield ImuSample(stamp, values[:3], values[3:])

    def bias_at(self, stamps: NDArray[np.int64]) -> FloatArray:  # noqa: D102
        at, knots = (
            np.asarray((s - self._bias_stamps[0]) * 1e-9, dtype=np.float64)
            for s in (stamps, self._bias_stamps)
        )
        return _interpolate(at, knots, self._bias)


def _interpolate(at: FloatArray, knots: FloatArray, rows: FloatArray) -> FloatArray:
    return np.stack([np.interp(at, knots, column) for column in rows.T], axis=1)
