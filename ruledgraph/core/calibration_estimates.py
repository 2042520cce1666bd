# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is estimated of the calibration while running: values with their uncertainty."""

from typing import NamedTuple

import gtsam

from ruledgraph.core.arrays import FloatArray


class TimeOffset(NamedTuple):
    """Of the camera's clock, and its standard deviation, s; a positive one says that frames are
    taken after their stamps on the IMU's clock.
    """

    value: float
    sigma: float

    def plus(self, other: float) -> "TimeOffset":
        """The sum with a known offset, s."""
        return TimeOffset(self.value + other, self.sigma)


NO_OFFSET = TimeOffset(0.0, 0.0)


class Extrinsics(NamedTuple):
    """How the camera is mounted on the body."""

    body_T_cam: gtsam.Pose3
    covariance: FloatArray
    """Of its tangent (GTSAM's: right perturbation, rotation first), (6, 6), rad and m."""


class FocalRatio(NamedTuple):
    """The camera's focal length over the calibration's, and its standard deviation."""

    value: float
    sigma: float
