# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether body and image rest."""

from collections.abc import Callable

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import RestConfig
from ruledgraph.frontend.image_motion import image_motion
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.rest import imu_rests
from ruledgraph.synchronization.frame_history import TIME_TOLERANCE, FrameHistory


class RestDetector:
    """Compares the motion by the IMU, and that of the image, with what rest shows.

    Args:
        imu: the samples.
        frames: their times.
        lines_moved: in the image since the frame of a stamp, see `Tracker.lines_moved`.
        config: what rest shows.
    """

    def __init__(
        self,
        imu: ImuBuffer,
        frames: FrameHistory,
        lines_moved: Callable[[int], tuple[FloatArray, FloatArray]],
        config: RestConfig,
    ) -> None:
        self._config = config
        self._span = config.duration - TIME_TOLERANCE
        self._imu = imu
        self._frames = frames
        self._lines_moved = lines_moved

    def is_still(self, time: float, rests_since: float | None = None) -> bool:
        """Whether body and image have rested until a time, for some time.

        Args:
            time: of a frame, s.
            rests_since: since when they have, as far as it is known: slow motion shows only then.
        """
        begin = time - self._config.duration
        if not self._imu.covers(begin, time):
            return False
        samples = self._imu.between(begin, time)
        readings = np.hstack([samples.gyroscope, samples.accelerometer])
        if not imu_rests(samples.times, readings, self._config):
            return False
        if rests_since is not None:
            begin = min(begin, self._kept(rests_since))
        return self.image_motion(begin) < self._config.image_motion_px

    def image_motion(self, since: float) -> float:
        """How far the image moved since a time, px; inf where that is not known."""
        frame = self._frames.at(since)
        if frame is None:
            return np.inf
        config = self._config
        moved = self._lines_moved(frame.stamp)
        return image_motion(*moved, config.image_motion_px, config.min_lines)

    def is_unmoved(self, since: float, moved: FloatArray) -> bool:
        """Whether there is nothing to solve for at rest: the image has not moved since a time (s),
        nor the body, by the IMU since the newest state (`moved`, (3,), m), further than by noise.
        """
        return self.is_noise(moved) and self.image_is_unmoved(since)

    def is_noise(self, moved: FloatArray) -> bool:
        """Whether a body at rest may seem to move so far, (3,), m."""
        return bool(np.all(np.abs(moved) < 3.0 * self._config.pose_sigma))

    def image_is_unmoved(self, since: float) -> bool:
        """Whether the image has not moved since a time (s), or since the first frame kept."""
        return self.image_motion(self._kept(since)) < self._config.unmoved_px

    def lines_moved(self, since: float) -> tuple[FloatArray, FloatArray]:
        """Lines and how far each has moved since then, see `Tracker.lines_moved`."""
        frame = self._frames.at(self._kept(since))
        return self._lines_moved((frame or self._frames.first).stamp)

    def _kept(self, since: float) -> float:
        return max(since, self._frames.first.time)

    def image_rests(self) -> bool:
        """Whether the image has rested until the last frame; without frames to compare it may."""
        if not self._frames or self._frames.last.time - self._frames.first.time < self._span:
            return True
        motion = self.image_motion(self._frames.last.time - self._span)
        return motion < self._config.image_motion_px
