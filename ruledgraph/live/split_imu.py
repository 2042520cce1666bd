# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""IMUs whose gyroscope and accelerometer stream apart, and clocks that begin anew."""

import threading
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.measurements import MAX_IMU_GAP

# A 32-bit counter of microseconds begins anew after 71.6 minutes, ns.
_TURN = 2**32 * 1000


class Clock:
    """Continues a 32-bit counter of microseconds, for all streams that are stamped by it."""

    def __init__(self) -> None:
        self._latest: int | None = None
        self._lock = threading.Lock()

    def unwrapped(self, stamp: int) -> int:
        """The stamp, ns, with the turns that are nearest to the latest one."""
        with self._lock:
            if self._latest is not None:
                stamp += round((self._latest - stamp) / _TURN) * _TURN
            self._latest = stamp if self._latest is None else max(stamp, self._latest)
            return stamp


class SplitImu:
    """Makes samples at the gyroscope's stamps, the specific force interpolated linearly.

    A sample waits for the accelerometer's next reading. Without one within `MAX_IMU_GAP` to both
    sides it is left out. May be used from two threads.

    Args:
        on_sample: called with angular velocity (3,), specific force (3,), and the stamp, ns.
    """

    def __init__(
        self,
        on_sample: Callable[[NDArray[np.float64], NDArray[np.float64], int], object],
    ) -> None:
        self._on_sample = on_sample
        self._waiting: deque[tuple[NDArray[np.float64], int]] = deque()
        self._forces: deque[tuple[NDArray[np.float64], int]] = deque(maxlen=2)
        self._lock = threading.Lock()

    def add_gyroscope(self, angular_velocity: NDArray[np.float64], stamp: int) -> None:
        """Add a reading (3,), rad/s."""
        with self._lock:
            self._waiting.append((angular_velocity, stamp))
            while self._waiting[0][1] < stamp - MAX_IMU_GAP:  # the accelerometer is silent
                self._waiting.popleft()
            self._hand_out()

    def add_accelerometer(self, force: NDArray[np.float64], stamp: int) -> None:
        """Add a reading (3,), m/s^2."""
        with self._lock:
            self._forces.append((force, stamp))
            self._hand_out()

    def _hand_out(self) -> None:
        if len(self._forces) < 2:
            return
        (before, begin), (after, end) = self._forces
        while self._waiting and self._waiting[0][1] <= end:
            angular_velocity, stamp = self._waiting.popleft()
            if begin <= stamp and 0 < end - begin <= MAX_IMU_GAP:
                share = (stamp - begin) / (end - begin)
                self._on_sample(angular_velocity, before + share * (after - before), stamp)
