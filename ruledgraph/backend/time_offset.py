# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset between camera and IMU, estimated in the window.

The times of frames are computed with the calibration's offset and a correction, what is known so
far. The variable T(k) is what is still missing, s: how much later the frames after state k were
taken. It stays near zero, where the line factors, of first order in it, are exact; a long-lived
variable would not, as the smoother does not linearise one anew whose neighbours have left the
window. Corrections differ from interval to interval, the offset hardly does:

    correction_k + T(k) = correction_{k-1} + T(k-1) + n,    n ~ N(0, random_walk^2 (t_k - t_{k-1})).
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import T

from ruledgraph.core.time_offset import TimeOffset


@dataclass(eq=False)
class OffsetLink:
    """The offset of the frames of one interval."""

    index: int
    """k, of its state."""
    time: float
    """Of that state, s."""
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

    def prior(self) -> gtsam.NonlinearFactor:
        """What is known of the first of a window."""
        noise = noiseModel.Isotropic.Sigma(1, self.sigma)
        return gtsam.PriorFactorDouble(self.key, self.shift, noise)

    def random_walk_factor(self, before: "OffsetLink", random_walk: float) -> gtsam.NonlinearFactor:
        """See the head of this file; `random_walk` in s/sqrt(s)."""
        noise = noiseModel.Isotropic.Sigma(1, random_walk * float(np.sqrt(self.time - before.time)))
        change = before.correction - self.correction
        return gtsam.BetweenFactorDouble(before.key, self.key, change, noise)
