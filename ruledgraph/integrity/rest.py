# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether body and image rest."""

from collections.abc import Callable

import numpy as np

from ruledgraph.imu.synchronizer import Synchronizer

# How long rest must last, s.
REST = 0.4
# At rest the gyroscope and the accelerometer hardly vary (rad/s, m/s^2), and the image does not
# move (px).
_STILL_GYROSCOPE, _STILL_ACCELEROMETER, _STILL_IMAGE = 0.02, 0.25, 0.4


class RestDetector:
    """Compares the IMU's variation and the image's motion with what rest shows.

    Args:
        sensors: with the samples and the frames' times.
        image_motion: of the lines since the frame of a stamp, px, see `Tracker.image_motion`.
    """

    def __init__(self, sensors: Synchronizer, image_motion: Callable[[int], float]) -> None:
        self._imu = sensors.imu
        self._frames = sensors.frames
        self._image_motion = image_motion

    def is_still(self, time: float, rests_since: float | None = None) -> bool:
        """Whether body and image have rested until a time, for some time.

        Args:
            time: of a frame, s.
            rests_since: since when they have, as far as it is known: slow motion shows only then.
        """
        begin = time - REST
        if rests_since is not None:
            begin = min(begin, max(rests_since, self._frames.first.time))
        if not self._imu.covers(begin, time):
            return False
        samples = self._imu.between(begin, time)
        return bool(
            samples.gyroscope.std(axis=0).max() < _STILL_GYROSCOPE
            and samples.accelerometer.std(axis=0).max() < _STILL_ACCELEROMETER
            and self.image_motion(begin) < _STILL_IMAGE
        )

    def image_motion(self, since: float) -> float:
        """How far the image moved since a time, px; inf where that is not known."""
        frame = self._frames.at(since)
        return np.inf if frame is None else self._image_motion(frame.stamp)
