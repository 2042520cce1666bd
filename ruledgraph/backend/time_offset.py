# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset between camera and IMU, estimated in the window.

The times of frames are computed with the calibration's offset plus a correction c, the estimate so
far. The variable T(k) is the residual offset, s: how much later the frames after state k were
taken. It stays near zero, where the line factors, of first order in it, are exact; a long-lived
variable would not, as the smoother does not linearise one anew whose neighbours have left the
window. Corrections differ from interval to interval, the offset hardly does:

    c_k + T(k) = c_{k-1} + T(k-1) + n,    n ~ N(0, random_walk^2 (t_k - t_{k-1})).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import gtsam
from gtsam import noiseModel
from gtsam.symbol_shorthand import T
from typing_extensions import Self

from ruledgraph.backend.camera_variable import CameraVariable
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.time_offset import TimeOffset


@dataclass(eq=False)
class TimeOffsetState(CameraVariable):
    """Variable of the time offset of one interval's frames."""

    SIZE: ClassVar[int] = 1

    offset_correction: float
    """c_k: what was added to the calibration's offset in the times of its frames, s."""
    residual_offset: float
    """The estimate of T(k), s."""
    sigma: float
    """Of that, when it was new."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return T(self.index)

    @property
    def offset(self) -> TimeOffset:
        """Estimated offset less the calibration's, s."""
        return TimeOffset(self.residual_offset, self.sigma).plus(self.offset_correction)

    def insert(self, values: gtsam.Values) -> None:
        """Add the estimate."""
        values.insert(self.key, self.residual_offset)

    def read(self, estimate: gtsam.Values) -> None:
        """Take over what the smoother found."""
        self.residual_offset = estimate.atDouble(self.key)

    def read_covariance(self, covariance: FloatArray) -> None:
        """Take over a marginal, (1, 1)."""
        self.sigma = math.sqrt(covariance[0, 0])

    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""
        noise = noiseModel.Isotropic.Sigma(1, self.sigma)
        return gtsam.PriorFactorDouble(self.key, self.residual_offset, noise)

    def random_walk_factor(self, before: Self, config: Config) -> gtsam.NonlinearFactor:
        """See the head of this file."""
        walk = config.time_offset.random_walk * math.sqrt(self.time - before.time)
        noise = noiseModel.Isotropic.Sigma(1, walk)
        change = before.offset_correction - self.offset_correction
        return gtsam.BetweenFactorDouble(before.key, self.key, change, noise)
