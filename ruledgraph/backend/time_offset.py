# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset between camera and IMU, estimated in the window.

The times of frames are computed with the calibration's offset and a correction, what is known so
far. The variable T(k) is what is still missing, s: how much later the frames after knot k were
taken. It stays near zero, where the line factors, of first order in it, are exact; a long-lived
variable would not, as the smoother does not linearise one anew whose neighbours have left the
window. Corrections differ from interval to interval, the offset hardly does:

    correction_k + T(k) = correction_{k-1} + T(k-1) + n,    n ~ N(0, walk^2 (t_k - t_{k-1})).
"""

from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import T

# The correction follows the estimate by so much a knot, s, so that frames stay in order.
_MOST_STEP = 2e-3
# An offset known this well, and followed this closely, is worth a warning when it is so far from
# the calibration, s.
_KNOWN, _FOLLOWED, _FAR = 1e-3, 5e-4, 3e-3
# A start whose offset comes out further from what its frames were timed with is tried again, s.
RETRY = 2e-3


class TimeOffset(NamedTuple):
    """What is known of an offset, s; a positive one says that frames are taken after their stamps
    on the IMU's clock.
    """

    value: float
    sigma: float

    def moved(self, by: float) -> "TimeOffset":
        """The same counted from elsewhere."""
        return TimeOffset(self.value + by, self.sigma)


NO_OFFSET = TimeOffset(0.0, 0.0)


@dataclass(eq=False)
class OffsetLink:
    """The offset of the frames of one interval."""

    index: int
    """k, of its knot."""
    time: float
    """Of that knot, s."""
    correction: float
    """What the times of its frames were computed with, beyond the calibration, s."""
    shift: float
    """The estimate of T(k), s."""
    sigma: float
    """Of that, when it was new."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return T(self.index)

    @property
    def offset(self) -> TimeOffset:
        """Beyond the calibration's."""
        return TimeOffset(self.shift, self.sigma).moved(self.correction)

    def prior(self, inflation: float = 1.0) -> gtsam.NonlinearFactor:
        """What is known of the first of a window."""
        noise = noiseModel.Isotropic.Sigma(1, self.sigma * inflation)
        return gtsam.PriorFactorDouble(self.key, self.shift, noise)

    def tie(self, before: "OffsetLink", walk: float) -> gtsam.NonlinearFactor:
        """See the head of this file; `walk` in s/sqrt(s)."""
        noise = noiseModel.Isotropic.Sigma(1, walk * float(np.sqrt(self.time - before.time)))
        change = before.correction - self.correction
        return gtsam.BetweenFactorDouble(before.key, self.key, change, noise)


def followed(correction: float, offset: TimeOffset) -> float:
    """The correction for the frames to come."""
    return correction + float(np.clip(offset.value - correction, -_MOST_STEP, _MOST_STEP))


def concern(correction: float, offset: TimeOffset, calibrated: float) -> str | None:
    """What to warn of: an offset that is well known and far from the calibration's, s."""
    settled = offset.sigma < _KNOWN and abs(offset.value - correction) < _FOLLOWED
    if not settled or abs(offset.value) < _FAR:
        return None
    return (
        f"frames are taken {1e3 * (calibrated + offset.value):.1f} ms after their stamps on the "
        f"IMU's clock (deviation {1e3 * offset.sigma:.1f} ms), not {1e3 * calibrated:.1f} ms as "
        "the calibration says: correct timeshift_cam_imu"
    )
