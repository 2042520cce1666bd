# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""When a start is tried, over which window, and what comes of it."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ruledgraph.backend.states import Start
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.frontend.tracks import Track
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.at_rest import start_at_rest
from ruledgraph.initialization.in_motion import start_in_motion
from ruledgraph.initialization.prior import Refusal

# How often a start is tried, s.
_BETWEEN_ATTEMPTS = 0.25
# Frames are on time when they come this much early, s.
_EARLY = 0.004


class TimedFrame(Protocol):
    """A frame that was processed."""

    @property
    def stamp(self) -> int:
        """ns, also its name."""

    @property
    def time(self) -> float:
        """s, on the IMU's clock."""


class Initializer:
    """Tries to begin a trajectory segment from what was seen so far."""

    def __init__(self, calibration: Calibration, config: Config) -> None:
        self._calibration = calibration
        self._config = config
        self._last_attempt = -np.inf

    def is_due(self, time: float) -> bool:
        """Whether it is time for another attempt, s."""
        return time - self._last_attempt >= _BETWEEN_ATTEMPTS - _EARLY

    def wait_from(self, time: float) -> None:
        """Count the time to the next attempt from here, s; from -inf: none to wait."""
        self._last_attempt = time

    def attempt(
        self,
        imu: ImuBuffer,
        frames: Sequence[TimedFrame],
        tracks: Sequence[Track],
        rest_since: float | None,
    ) -> Start | Refusal | None:
        """A start, or why there is none; None while there is too little to try.

        In motion it is tried over the longest window that there is, then over the shortest: the
        longer one knows more, in the shorter one fewer lines were lost.

        Args:
            imu: samples up to the last frame.
            frames: the last of them, in order.
            tracks: lines followed through them.
            rest_since: when the body came to rest, s; None while it moves.
        """
        last = frames[-1]
        if rest_since is not None:
            self._last_attempt = last.time
            return start_at_rest(imu, last.stamp, rest_since, last.time, self._config)
        start, refusal = self._config.start, None
        available = last.time - frames[0].time
        shortest = min(start.shortest, start.window)
        if available < shortest - _EARLY:
            return None
        lengths = [min(start.window, available)]
        if lengths[0] > shortest + _EARLY:
            lengths.append(shortest)
        for length in lengths:
            if imu.doubts(last.time - length, last.time):
                continue
            used = [f for f in frames if f.time >= last.time - length - _EARLY]
            stamps, times = [f.stamp for f in used], [f.time for f in used]
            found = start_in_motion(imu, stamps, times, tracks, self._calibration, self._config)
            self._last_attempt = last.time
            if isinstance(found, Start):
                return found
            refusal = refusal or found
        return refusal
