# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU samples of the last seconds, and where they are unreliable."""

import bisect
from collections import deque
from collections.abc import Iterable, Sequence

import gtsam
import numpy as np

from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, ImuConfig
from ruledgraph.imu.faults import SaturationDetector, UnreliableInterval
from ruledgraph_factors import ImuSamples

# Repetitions are kept one by one for so long, s: more than frames are apart.
_REPEATS_KEPT = 2.0


class ImuBuffer:
    """Samples in order of time (s), appended one by one and forgotten from the front.

    Repeated readings of a frozen IMU are not used. Whether it is frozen shows only later: a reading
    that is the same as the one before is held back until another one comes.
    """

    def __init__(self, config: ImuConfig = DEFAULTS.imu) -> None:
        self._config = config
        self._times: list[float] = []
        self._values: list[FloatArray] = []
        self._repeats: list[float] = []
        self._dropouts: deque[UnreliableInterval] = deque()
        self._range = SaturationDetector(config)
        self.gravity = config.gravity_in_world
        """Where the samples are taken, in the world, (3,), m/s^2."""
        self.range_message = ""
        """Message about the sensors' range after the last sample, empty if there is none."""

    def append(self, time: float, gyroscope: FloatArray, accelerometer: FloatArray) -> float:
        """Add a sample; one that is not later than the last is ignored.

        Returns:
            How long the IMU was frozen before it, s.
        """
        frozen, self.range_message = 0.0, ""
        if time <= (self._repeats or self._times or [-np.inf])[-1]:
            return frozen
        value = np.concatenate([gyroscope, accelerometer])
        if self._values and (value == self._values[-1]).all():
            if self.frozen_for > _REPEATS_KEPT:
                self._repeats.pop()
            self._repeats.append(time)
            return frozen
        if len(self._repeats) >= self._config.frozen_repeats:
            frozen = self.frozen_for
            self._repeats.clear()
        self.accept_repeats()
        self._append(time, value)
        self.range_message = self._range.add(time, value)
        return frozen

    @property
    def frozen_for(self) -> float:
        """How long it has repeated one reading, s."""
        return self._repeats[-1] - self._times[-1] if self._repeats else 0.0

    def accept_repeats(self) -> None:
        """Take the repetitions held back for samples: the body rests, and the IMU has no noise."""
        for repeated in self._repeats:
            self._append(repeated, self._values[-1])
        self._repeats.clear()

    def _append(self, time: float, value: FloatArray) -> None:
        if self._times and time - self._times[-1] > self._config.max_sample_interval:
            self._dropouts.append(_dropout(self._times[-1], time, self._config))
        self._times.append(time)
        self._values.append(value)

    @property
    def latest(self) -> float:
        """Time of the last sample, -inf if there is none."""
        return self._times[-1] if self._times else -np.inf

    @property
    def earliest(self) -> float:
        """Time of the first sample, inf if there is none."""
        return self._times[0] if self._times else np.inf

    def covers(self, start: float, stop: float) -> bool:
        """Whether there are samples at or beyond both ends."""
        return len(self._times) > 1 and self._times[0] <= start and self._times[-1] >= stop

    def between(self, start: float, stop: float) -> ImuSamples:
        """The samples of [start, stop] and one beyond each end."""
        part = self._part(start, stop)
        values = np.array(self._values[part])
        return ImuSamples(self._times[part], values[:, :3], values[:, 3:])

    def unreliable(self, start: float, stop: float) -> list[UnreliableInterval]:
        """Where in (start, stop) samples are too far apart, or at the end of the range."""
        return [
            *_overlapping(self._dropouts, start, stop),
            *_overlapping(self._range.unreliable, start, stop),
        ]

    def in_long_dropout(self, time: float) -> bool:
        """Whether it is so long since the last sample that lines are no longer where expected."""
        longest = self._config.max_dropout
        return any(time - at.start > longest for at in _overlapping(self._dropouts, time, time))

    def was_degraded(self, time: float) -> bool:
        """Whether it was `interrupted` not long before."""
        return self.interrupted(time - self._config.unsure_time, time)

    def interrupted(self, start: float, stop: float) -> bool:
        """Whether lines may have been lost over a dropout in (start, stop), or readings clipped."""
        dropouts = _overlapping(self._dropouts, start, stop)
        is_long = any(at.stop - at.start > self._config.max_dropout for at in dropouts)
        return is_long or bool(_overlapping(self._range.unreliable, start, stop))

    def _part(self, start: float, stop: float) -> slice:
        first = max(bisect.bisect_right(self._times, start) - 1, 0)
        return slice(first, bisect.bisect_left(self._times, stop) + 1)

    def forget(self, before: float) -> None:
        """Drop what is not needed to interpolate at or after `before`."""
        keep = max(bisect.bisect_right(self._times, before) - 2, 0)
        del self._times[:keep], self._values[:keep]
        while self._dropouts and self._dropouts[0].stop < before:
            self._dropouts.popleft()
        self._range.forget(before)

    def clear(self) -> None:
        """Drop everything."""
        self._times.clear()
        self._values.clear()
        self._repeats.clear()
        self._dropouts.clear()
        self._range.interrupt()


def _dropout(start: float, stop: float, config: ImuConfig) -> UnreliableInterval:
    shorter = min((stop - start) / config.long_dropout, 1.0) ** 2
    sigmas = np.repeat([config.dropout_rate_sigma, config.dropout_force_sigma], 3)
    return UnreliableInterval(start, stop, shorter * sigmas)


def _overlapping(
    intervals: Iterable[UnreliableInterval], start: float, stop: float
) -> list[UnreliableInterval]:
    return [i for i in intervals if i.stop > start and i.start < stop]


def params_across(
    noise: ImuNoise,
    gravity: FloatArray,
    unreliable: Sequence[UnreliableInterval],
    start: float,
    stop: float,
) -> gtsam.PreintegrationCombinedParams:
    """The noise of what is integrated from start to stop across degraded stretches.

    The error within a stretch hardly changes. White noise with the same integral at its end has a
    density that grows with the root of its length.
    """
    variance = np.zeros(6)
    for interval in unreliable:
        length = interval.stop - interval.start
        inside = min(interval.stop, stop) - max(interval.start, start)
        variance += interval.sigmas**2 * length * inside / (stop - start)
    params = noise.preintegration_params(gravity)
    params.setGyroscopeCovariance(np.diag(noise.gyroscope**2 + variance[:3]))
    params.setAccelerometerCovariance(np.diag(noise.accelerometer**2 + variance[3:]))
    return params
