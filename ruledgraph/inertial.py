# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU samples of the last seconds, and what is not known where there are none."""

import bisect
import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ruledgraph.sensors import FloatArray, ImuNoise
from ruledgraph_factors import ImuSamples

# A longer stretch without a sample is a hole, s.
_HOLE = 0.05
# A reading that comes again so many times, to the last bit, is that of an IMU that hangs.
_REPEATS = 4
# What a straight line between two samples leaves open of rate and specific force (rad/s, m/s^2),
# when they are this far apart (s) or further; of a shorter hole it is the square of that.
_OPEN_RATE, _OPEN_FORCE, _LONG = 0.5, 1.5, 0.2


class Hole(NamedTuple):
    """A stretch between two samples, s."""

    start: float
    stop: float


class ImuBuffer:
    """Samples in order of time (s), appended one by one and forgotten from the front.

    Readings of an IMU that hangs are no samples. Whether it does shows only later: a reading that
    is the same as the one before is held back until another one comes.
    """

    def __init__(self) -> None:
        self._times: list[float] = []
        self._values: list[FloatArray] = []
        self._repeats: list[float] = []

    def append(self, time: float, gyroscope: FloatArray, accelerometer: FloatArray) -> float:
        """Add a sample; one that is not later than the last is ignored.

        Returns:
            How long the IMU hung before it, s.
        """
        hung = 0.0
        if time <= (self._repeats or self._times or [-np.inf])[-1]:
            return hung
        value = np.concatenate([gyroscope, accelerometer])
        if self._values and (value == self._values[-1]).all():
            self._repeats.append(time)
            return hung
        if len(self._repeats) >= _REPEATS:
            hung = self._repeats[-1] - self._times[-1]
        else:
            self._times += self._repeats
            self._values += self._values[-1:] * len(self._repeats)
        self._repeats.clear()
        self._times.append(time)
        self._values.append(value)
        return hung

    @property
    def latest(self) -> float:
        """Time of the last sample, -inf if there is none."""
        return self._times[-1] if self._times else -np.inf

    def covers(self, start: float, stop: float) -> bool:
        """Whether there are samples at or beyond both ends."""
        return len(self._times) > 1 and self._times[0] <= start and self._times[-1] >= stop

    def between(self, start: float, stop: float) -> ImuSamples:
        """The samples of [start, stop] and one beyond each end."""
        part = self._part(start, stop)
        values = np.array(self._values[part])
        return ImuSamples(self._times[part], values[:, :3], values[:, 3:])

    def holes(self, start: float, stop: float) -> list[Hole]:
        """Where in (start, stop) samples are too far apart."""
        times = self._times[self._part(start, stop)]
        found = [Hole(*pair) for pair in itertools.pairwise(times)]
        return [
            hole
            for hole in found
            if hole.stop - hole.start > _HOLE and hole.stop > start and hole.start < stop
        ]

    def _part(self, start: float, stop: float) -> slice:
        first = max(bisect.bisect_right(self._times, start) - 1, 0)
        return slice(first, bisect.bisect_left(self._times, stop) + 1)

    def forget(self, before: float) -> None:
        """Drop what is not needed to interpolate at or after `before`."""
        keep = max(bisect.bisect_right(self._times, before) - 2, 0)
        del self._times[:keep], self._values[:keep]

    def clear(self) -> None:
        """Drop everything."""
        self._times.clear()
        self._values.clear()
        self._repeats.clear()


def noise_across(noise: ImuNoise, holes: Sequence[Hole], start: float, stop: float) -> ImuNoise:
    """The noise of what is integrated from start to stop across holes.

    What a hole leaves open does not change much within it: as white noise that leaves the same at
    its end it has a density that grows with the root of its length.
    """
    rate, force = noise.gyroscope**2, noise.accelerometer**2
    for hole in holes:
        length = hole.stop - hole.start
        inside = min(hole.stop, stop) - max(hole.start, start)
        share = min(length / _LONG, 1.0) ** 4 * length * inside / (stop - start)
        rate += _OPEN_RATE**2 * share
        force += _OPEN_FORCE**2 * share
    return replace(noise, gyroscope=float(np.sqrt(rate)), accelerometer=float(np.sqrt(force)))
