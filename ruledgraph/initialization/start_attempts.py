# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""When a start is tried, and with which frames."""

from typing import NamedTuple

import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.timing import Messages
from ruledgraph.frontend.front_end import FrontEnd
from ruledgraph.imu.camera_clock import RETRY
from ruledgraph.imu.frame_history import EARLY, FrameTime
from ruledgraph.imu.synchronizer import Synchronizer
from ruledgraph.initialization.initializer import Refusal, start_at_rest, start_in_motion
from ruledgraph.integrity.rest import REST, RestDetector

# How often a start is tried, s.
_BETWEEN_ATTEMPTS = 0.25


class FirstFrames(NamedTuple):
    """A start, and the frames it was made of; the window begins at the first of them."""

    start: Start
    frames: list[FrameTime]


class StartAttempts:
    """Tries to start, at rest or in motion, from what was seen so far."""

    def __init__(
        self,
        calibration: Calibration,
        config: Config,
        sensors: Synchronizer,
        front_end: FrontEnd,
        rest: RestDetector,
        warnings: Messages,
    ) -> None:
        self._calibration = calibration
        self._config = config
        self._sensors = sensors
        self._front_end = front_end
        self._rest = rest
        self._warnings = warnings
        self._last = -np.inf
        self._retimed = False

    def wait_from(self, time: float) -> None:
        """Try again some time after this one, s."""
        self._last = time

    def attempt(self, now: FrameTime) -> FirstFrames | None:
        """A start at the latest frame, if what was seen allows one."""
        if now.time - self._last < _BETWEEN_ATTEMPTS:
            return None
        imu, frames = self._sensors.imu, self._sensors.frames
        length = self._config.start.window
        if self._rest.is_still(now.time):
            used = [now]
            result = start_at_rest(imu, now.stamp, now.time - REST, now.time, self._config)
        elif imu.doubts(now.time - length, now.time):
            return None
        elif now.time - frames.first.time >= length - EARLY:
            used = frames.since(now.time - length)
            stamps, times = [f.stamp for f in used], [f.time for f in used]
            tracks = self._front_end.observed()
            result = start_in_motion(imu, stamps, times, tracks, self._calibration, self._config)
        else:
            return None
        self._last = now.time
        if isinstance(result, Refusal):
            self._retimed = False
            self._warnings.append(f"no start at {now.time:.2f} s: {result.reason}")
            return None
        retimed, self._retimed = self._retimed, False
        offset = result.time_offset
        if offset is not None and abs(offset.value) > RETRY and not retimed:
            self._retime(offset.value)
            return None
        return FirstFrames(result, used)

    def _retime(self, change: float) -> None:
        """Move all frames in time before a start that is tried again with the next one."""
        self._retimed, self._last = True, -np.inf
        self._sensors.retime(change)
        self._front_end.retime(change)
