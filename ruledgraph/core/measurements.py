# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the sensors deliver. Recordings and simulator produce it, the odometry consumes it.

Stamps are nanoseconds as in the recording (int64 range); the camera's and the IMU's clock may
differ by the calibration's time offset.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

STAMP_JITTER = 4_000_000
"""ns; frames that come so much before their time are on time: well below a frame at 90 Hz."""

MAX_IMU_GAP = 500_000_000
"""ns; across a longer silence of the IMU its samples are neither interpolated nor integrated."""


@dataclass(frozen=True, eq=False)
class Frame:
    """An image: grey, (height, width) uint8, which does not change afterwards: it may be read by
    another thread, and compared with the next one. Hand in a copy of a buffer that serves again.
    """

    stamp: int
    image: NDArray[np.uint8]


class ImuSample(NamedTuple):
    """Angular velocity (3,), rad/s, and specific force (3,), m/s^2, in the body frame."""

    stamp: int
    gyroscope: NDArray[np.float64]
    accelerometer: NDArray[np.float64]


class Gap(NamedTuple):
    """The IMU was silent from `start` to `stop`, its samples before and after, for too long to
    integrate across: one segment of the motion ended, a new one begins.
    """

    start: int
    stop: int


Measurement: TypeAlias = Frame | ImuSample | Gap
"""In time order; a gap comes at its `stop`, just before the sample that ends it."""
