# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""When a start is tried, over which window, and what comes of it."""

from typing import NamedTuple

import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.core.config import Config
from ruledgraph.initialization.at_rest import start_at_rest
from ruledgraph.initialization.calibration_search import CalibrationSearch
from ruledgraph.initialization.in_motion import start_in_motion
from ruledgraph.initialization.prior import Refusal
from ruledgraph.stages import Stages
from ruledgraph.synchronization.frame_history import TIME_TOLERANCE, FrameTime


class FirstFrames(NamedTuple):
    """A start, and the frames it was made of; the window begins at the first of them."""

    start: Start
    frames: list[FrameTime]


class Initializer:
    """Tries to begin a trajectory segment from what was seen so far, at rest or in motion.

    Args:
        stages: with the IMU samples, the times of the frames and the line tracks.
        calibration_search: of the time offset, by the rotation seen in the images.
        config: all settings.
    """

    def __init__(
        self, stages: Stages, calibration_search: CalibrationSearch, config: Config
    ) -> None:
        self._stages = stages
        self._calibration_search = calibration_search
        self._config = config
        self._warnings = stages.output.warnings
        self._last_attempt = -np.inf
        self._retimed = False
        self.refusal = ""
        """Why the last attempt failed."""

    def wait_from(self, time: float) -> None:
        """Count the time to the next attempt from here, s."""
        self._last_attempt = time

    def restart(self, reason: str) -> None:
        """Forget the last attempt; the reason stands until the next one fails."""
        self._retimed, self.refusal = False, reason

    def is_due(self, time: float) -> bool:
        """Whether it is time for another attempt, s."""
        return time - self._last_attempt >= self._config.start.between_attempts - TIME_TOLERANCE

    def attempt(self, now: FrameTime) -> FirstFrames | None:
        """A start at the latest frame, if what was seen allows one; says why if it does not."""
        if not self.is_due(now.time):
            return None
        is_still = self._stages.rest_detector.is_still(now.time)
        found = self._at_rest(now) if is_still else self._in_motion(now)
        if found is None:
            return None
        if isinstance(found, Start):
            found = self._with_checked_offset(found)
        if isinstance(found, Refusal):
            self._retimed, self.refusal = False, found.reason
            self._warnings.append(f"no start at {now.time:.2f} s: {found.reason}")
            return None
        retimed, self._retimed = self._retimed, False
        offset = found.time_offset
        max_step = self._config.time_offset.max_step
        if offset is not None and abs(offset.value) > max_step and not retimed:
            self.retime(offset.value)
            self._retimed = True
            return None
        self.refusal = ""
        frames = [frame for frame in self._stages.synchronizer.frames if frame.stamp >= found.stamp]
        return FirstFrames(found, frames)

    def _with_checked_offset(self, start: Start) -> Start | Refusal:
        """A start, unless images may show that its time offset is another one."""
        if start.time_offset is None:
            return start
        calibrated = self._stages.online_calibration.current.time_offset
        offset = calibrated + self._stages.synchronizer.offset_correction + start.time_offset.value
        if not self._calibration_search.contradicts_known(offset):
            return start
        return Refusal(
            f"the start suggests a time offset of {1e3 * offset:.0f} ms: waiting until the camera "
            "has turned enough to confirm it"
        )

    def _at_rest(self, now: FrameTime) -> Start | Refusal:
        self._last_attempt = now.time
        since, prior = now.time - self._config.rest.duration, self._stages.clock.start_prior
        imu = self._stages.synchronizer.imu
        return start_at_rest(imu, now.stamp, since, now.time, self._config, prior)

    def _in_motion(self, now: FrameTime) -> Start | Refusal | None:
        """Over the longest window that there is, which has the most information, or else over the
        shortest, in which the fewest tracks were lost.
        """
        longest = min(self._config.start.longest, self._config.window.lag)
        stages = self._stages
        imu, frames = stages.synchronizer.imu, stages.synchronizer.frames
        available = now.time - frames.first.time
        shortest = min(self._config.start.shortest, longest)
        if available < shortest - TIME_TOLERANCE:
            return None
        longest = min(longest, available)
        differ = longest - shortest >= self._config.start.between_attempts - TIME_TOLERANCE
        refusal: Refusal | None = None
        for length in (longest, shortest) if differ else (longest,):
            if imu.interrupted(now.time - length, now.time):
                continue
            self._last_attempt = now.time
            used = frames.since(now.time - length)
            found = start_in_motion(
                imu,
                used,
                stages.front_end.observed(),
                stages.online_calibration.current,
                self._config,
                stages.clock.start_prior,
                stages.online_calibration.ratio,
            )
            if isinstance(found, Start):
                return found
            refusal = refusal or found
        if refusal is None:
            self.refusal = f"IMU samples are missing or clipped in the last {longest:.1f} s"
            self._warnings.once("interrupted", f"no start at {now.time:.2f} s: {self.refusal}")
        return refusal

    def retime(self, change: float) -> None:
        """Move all frames in time, s, and try again with the next one."""
        self._last_attempt = -np.inf
        self._stages.synchronizer.retime(change)
        self._stages.front_end.retime(change)
