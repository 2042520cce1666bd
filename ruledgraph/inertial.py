# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU samples of the last seconds."""

import bisect

import numpy as np

from ruledgraph.sensors import FloatArray
from ruledgraph_factors import ImuSamples


class ImuBuffer:
    """Samples in order of time (s), appended one by one and forgotten from the front."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._values: list[FloatArray] = []

    def append(self, time: float, gyroscope: FloatArray, accelerometer: FloatArray) -> None:
        """Add a sample; one that is not later than the last is ignored."""
        if not self._times or time > self._times[-1]:
            self._times.append(time)
            self._values.append(np.concatenate([gyroscope, accelerometer]))

    @property
    def latest(self) -> float:
        """Time of the last sample, -inf if there is none."""
        return self._times[-1] if self._times else -np.inf

    def covers(self, start: float, stop: float) -> bool:
        """Whether there are samples at or beyond both ends."""
        return len(self._times) > 1 and self._times[0] <= start and self._times[-1] >= stop

    def between(self, start: float, stop: float) -> ImuSamples:
        """The samples of [start, stop] and one beyond each end."""
        first = max(bisect.bisect_right(self._times, start) - 1, 0)
        last = bisect.bisect_left(self._times, stop) + 1
        values = np.array(self._values[first:last])
        return ImuSamples(self._times[first:last], values[:, :3], values[:, 3:])

    def forget(self, before: float) -> None:
        """Drop what is not needed to interpolate at or after `before`."""
        keep = max(bisect.bisect_right(self._times, before) - 2, 0)
        del self._times[:keep], self._values[:keep]

    def clear(self) -> None:
        """Drop everything."""
        self._times.clear()
        self._values.clear()
