# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Faulty readings of the IMU: single spikes, and saturation at the ends of a sensor's range.

A reading is gyroscope and accelerometer together, (6,), rad/s and m/s^2; times are s.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, ImuConfig

# A sensor's step is the first decile of so many changes, some seconds of them: where readings were
# interpolated at stamps in between, the least change is much smaller.
_CHANGES, _OF_STEPS = 1000, 0.1


class Reading(NamedTuple):
    """A sample as it is used."""

    time: float
    value: FloatArray
    replaced: bool = False
    """Whether it was a spike: this is what its neighbours say."""


class SpikeFilter:
    """Passes readings on; a single one far from both its neighbours is replaced by the straight
    line between them.

    A reading that might be a spike waits for the next one; no other is delayed.
    """

    def __init__(self, config: ImuConfig = DEFAULTS.imu) -> None:
        self._config = config
        self._least = np.repeat([config.spike_rate, config.spike_force], 3)
        self._before: Reading | None = None
        self._held: Reading | None = None
        self._usual = np.zeros(6)
        self._since = -np.inf

    def take(self, time: float, value: FloatArray) -> list[Reading]:
        """The readings that are ready now, in order. One that comes late is left out."""
        last = self._held or self._before
        if last is not None and time <= last.time:
            return []
        ready = []
        before, held, self._held = self._before, self._held, None
        if before is not None and held is not None:
            if self._is_back(before, held, time, value):
                share = (held.time - before.time) / (time - before.time)
                line = before.value + share * (value - before.value)
                held = Reading(held.time, line, replaced=True)
            ready.append(self._pass(held))
        new = Reading(time, value)
        if self._is_far(new).any():
            self._held = new
        else:
            ready.append(self._pass(new))
        return ready

    def _is_far(self, reading: Reading) -> NDArray[np.bool_]:
        """By axes, whether it departs from the reading before it by more than is usual."""
        before = self._before
        if (
            before is None
            or reading.time - self._since < self._config.spike_watch_time
            or reading.time - before.time > self._config.max_sample_interval
        ):
            return np.zeros(6, dtype=bool)
        jump = np.abs(reading.value - before.value)
        return np.asarray(jump > np.maximum(self._least, self._config.spike_factor * self._usual))

    def _is_back(self, before: Reading, held: Reading, time: float, value: FloatArray) -> bool:
        if time - held.time > self._config.max_sample_interval:
            return False
        jump, rest = np.abs(held.value - before.value), np.abs(value - before.value)
        return bool(np.any(self._is_far(held) & (rest < self._config.spike_return * jump)))

    def _pass(self, reading: Reading) -> Reading:
        before, self._before = self._before, reading
        if before is None or reading.time - before.time > self._config.max_sample_interval:
            self._usual, self._since = np.zeros(6), reading.time
        else:
            fading = math.exp(-(reading.time - before.time) / self._config.spike_memory)
            change = np.abs(reading.value - before.value)
            self._usual = np.maximum(change, fading * self._usual)
        return reading


class UnreliableInterval(NamedTuple):
    """A stretch of time, s, in which the IMU is worse than its noise figures."""

    start: float
    stop: float
    sigmas: FloatArray
    """Standard deviations of rate (rad/s) and specific force (m/s^2) there, by axes, (6,)."""


class SaturationDetector:
    """Finds where the axes of a sensor end, by readings that stay there, and when they do.

    The axes of one sensor have one range: none ends where another one went well beyond.
    """

    def __init__(self, config: ImuConfig = DEFAULTS.imu) -> None:
        self._config = config
        self.unreliable: list[UnreliableInterval] = []
        """Stretches with clipped readings, in order."""
        # All by axes and directions, (12,): upwards, then downwards.
        self._farthest = np.full(12, -np.inf)
        self._is_end = np.zeros(12, dtype=bool)
        self._touches: list[deque[float]] = [deque() for _ in range(12)]
        self._changes: list[deque[float]] = [deque(maxlen=_CHANGES) for _ in range(6)]
        self._recent: deque[tuple[float, FloatArray]] = deque()

    def add(self, time: float, value: FloatArray) -> str:
        """Take in a reading.

        Returns:
            What ends where, if that is found now.
        """
        both = np.concatenate([value, -value])
        found = []
        if self._recent:
            before = self._recent[-1][1]
            change = np.abs(both[:6] - before[:6])
            for changes, size in zip(self._changes, change.tolist(), strict=True):
                if size > 0.0:
                    changes.append(size)
            for i in (both >= self._farthest).nonzero()[0].tolist():
                if both[i] > self._farthest[i]:
                    self._farthest[i] = both[i]
                    self._is_end[i] = False
                    self._touches[i].clear()
                if not self._is_end[i] and self._ends(i, time, change):
                    self._is_end[i] = True
                    found.append(_described(i, self._farthest[i]))
                    self._mark(i, self._touches[i][0], time)
                elif self._is_end[i] and self._may_end(i):
                    self._mark(i, self._recent[-1][0], time)
        self._recent.append((time, both))
        while self._recent[0][0] < time - 2.0 * self._config.range_span:
            self._recent.popleft()
        return "; ".join(found)

    def _ends(self, i: int, time: float, change: FloatArray) -> bool:
        """Take in a touch; whether it shows the end."""
        sensor = i % 6 // 3 * 3
        if np.count_nonzero(change[sensor : sensor + 3]) == 0:
            return False  # it may be the same reading handed out again
        touches = self._touches[i]
        touches.append(time)
        while touches[0] < time - self._config.range_span:
            touches.popleft()
        changes = self._changes[i % 6]
        if len(touches) < self._config.range_touches or not (changes and self._may_end(i)):
            return False
        # A parabola whose top stays within one step for so long was three steps lower half as
        # long before.
        since = touches[0] - 0.5 * (time - touches[0])
        earlier = [both[i] for t, both in self._recent if since <= t < touches[0]]
        drop = self._farthest[i] - min(earlier, default=np.inf)
        return bool(drop > self._config.range_steps * np.quantile(changes, _OF_STEPS))

    def _may_end(self, i: int) -> bool:
        """Whether no axis of the sensor went well beyond."""
        sensor = i % 6 // 3 * 3
        of_sensor = self._farthest.reshape(2, 6)[:, sensor : sensor + 3]
        return bool(self._farthest[i] >= self._config.range_share * of_sensor.max())

    def _mark(self, i: int, start: float, stop: float) -> None:
        sigmas = np.zeros(6)
        sigmas[i % 6] = self._config.range_open_share * abs(self._farthest[i])
        while self.unreliable and self.unreliable[-1].stop >= start - self._config.range_join_time:
            last = self.unreliable.pop()
            start, sigmas = min(start, last.start), np.maximum(sigmas, last.sigmas)
        self.unreliable.append(UnreliableInterval(start, stop, sigmas))

    def interrupt(self) -> None:
        """What comes next does not follow on what came before; ends that were found stay."""
        self.unreliable = []
        self._recent.clear()
        for touches in self._touches:
            touches.clear()

    def forget(self, before: float) -> None:
        """Drop stretches that ended before a time."""
        self.unreliable = [interval for interval in self.unreliable if interval.stop >= before]


def _described(i: int, end: float) -> str:
    sensor, unit = (("gyroscope", "rad/s"), ("accelerometer", "m/s^2"))[i % 6 // 3]
    return f"the {sensor}'s {'xyz'[i % 3]} ends at {end if i < 6 else -end:.4g} {unit}"
