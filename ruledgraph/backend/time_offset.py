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

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import T

from ruledgraph.core.time_offset import TimeOffset


@dataclass(eq=False)
class TimeOffsetState:
    """Variable of the time offset of one interval's frames."""

    index: int
    """k, of its state."""
    time: float
    """Of that state, s."""
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

    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""
        noise = noiseModel.Isotropic.Sigma(1, self.sigma)
        return gtsam.PriorFactorDouble(self.key, self.residual_offset, noise)

    def random_walk_factor(
        self, before: "TimeOffsetState", random_walk: float
    ) -> gtsam.NonlinearFactor:
        """See the head of this file; `random_walk` in s/sqrt(s)."""
        noise = noiseModel.Isotropic.Sigma(1, random_walk * float(np.sqrt(self.time - before.time)))
        change = before.offset_correction - self.offset_correction
        return gtsam.BetweenFactorDouble(before.key, self.key, change, noise)
