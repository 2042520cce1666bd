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

import gtsam
from gtsam import noiseModel
from gtsam.symbol_shorthand import T
from typing_extensions import Self

from ruledgraph.backend.camera_variable import ScalarVariable
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config


@dataclass(eq=False)
class TimeOffsetVariable(ScalarVariable):
    """Variable of the time offset of one interval's frames; `value` is T(k), s."""

    offset_correction: float
    """c_k: what was added to the calibration's offset in the times of its frames, s."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return T(self.index)

    @property
    def offset(self) -> TimeOffset:
        """Estimated offset less the calibration's, s."""
        return TimeOffset(self.value, self.sigma).plus(self.offset_correction)

    def random_walk_factor(self, before: Self, config: Config) -> gtsam.NonlinearFactor:
        """See the head of this file."""
        walk = config.time_offset.random_walk * math.sqrt(self.time - before.time)
        noise = noiseModel.Isotropic.Sigma(1, walk)
        change = before.offset_correction - self.offset_correction
        return gtsam.BetweenFactorDouble(before.key, self.key, change, noise)
