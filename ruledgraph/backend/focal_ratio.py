# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's focal length, estimated in the window.

The variable F(k) is the focal length in the frames after state k over the calibration's. Both focal
lengths of a camera have the same ratio. It is tied to the last by

    F(k) = F(k-1) + n,    n ~ N(0, random_walk^2 (t_k - t_{k-1})).
"""

import math
from dataclasses import dataclass

import gtsam
from gtsam import noiseModel
from gtsam.symbol_shorthand import F
from typing_extensions import Self

from ruledgraph.backend.camera_variable import ScalarVariable
from ruledgraph.core.config import Config
from ruledgraph.core.focal_ratio import FocalRatio


@dataclass(eq=False)
class FocalRatioState(ScalarVariable):
    """Variable of the focal length in one interval's frames."""

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
