# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's focal length, estimated in the window.

The variable F(k) is the focal length over the calibration's in the frames from state k to state l,
the first for which there is another variable, at least `window.camera_period` later. Both focal
lengths of a camera have the same ratio. A random walk leads to the next one,

    F(l) = F(k) + n,    n ~ N(0, random_walk^2 (t_l - t_k)).
"""

import math
from dataclasses import dataclass

import gtsam
from gtsam import noiseModel
from gtsam.symbol_shorthand import F
from typing_extensions import Self

from ruledgraph.backend.camera_variable import ScalarVariable
from ruledgraph.core.calibration_estimates import FocalRatio
from ruledgraph.core.config import Config


@dataclass(eq=False)
class FocalRatioVariable(ScalarVariable):
    """Variable of the focal length in the frames of one `window.camera_period`."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return F(self.index)

    @property
    def focal_ratio(self) -> FocalRatio:
        """The estimate."""
        return FocalRatio(self.value, self.sigma)

    def random_walk_factor(self, before: Self, config: Config) -> gtsam.NonlinearFactor:
        """See the head of this file."""
        walk = config.intrinsics.focal_random_walk * math.sqrt(self.time - before.time)
        noise = noiseModel.Isotropic.Sigma(1, walk)
        return gtsam.BetweenFactorDouble(before.key, self.key, 0.0, noise)
