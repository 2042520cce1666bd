# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's focal length, estimated in the window.

The variable F(k) is the focal length in the frames after state k over the calibration's. Both focal
lengths of a camera have the same ratio. It is tied to the last by

    F(k) = F(k-1) + n,    n ~ N(0, random_walk^2 (t_k - t_{k-1})).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import gtsam
from gtsam import noiseModel
from gtsam.symbol_shorthand import F
from typing_extensions import Self

from ruledgraph.backend.camera_variable import CameraVariable
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.focal_ratio import FocalRatio


@dataclass(eq=False)
class FocalRatioState(CameraVariable):
    """Variable of the focal length in one interval's frames."""

    SIZE: ClassVar[int] = 1

    ratio: float
    """The estimate of F(k)."""
    sigma: float
    """Of that, when it was new."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return F(self.index)

    @property
    def focal_ratio(self) -> FocalRatio:
        """The estimate."""
        return FocalRatio(self.ratio, self.sigma)

    def insert(self, values: gtsam.Values) -> None:
        """Add the estimate."""
        values.insert(self.key, self.ratio)

    def read(self, estimate: gtsam.Values) -> None:
        """Take over what the smoother found."""
        self.ratio = estimate.atDouble(self.key)

    def read_covariance(self, covariance: FloatArray) -> None:
        """Take over a marginal, (1, 1)."""
        self.sigma = math.sqrt(covariance[0, 0])

    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""
        noise = noiseModel.Isotropic.Sigma(1, self.sigma)
        return gtsam.PriorFactorDouble(self.key, self.ratio, noise)

    def random_walk_factor(self, before: Self, config: Config) -> gtsam.NonlinearFactor:
        """See the head of this file."""
        walk = config.intrinsics.focal_random_walk * math.sqrt(self.time - before.time)
        noise = noiseModel.Isotropic.Sigma(1, walk)
        return gtsam.BetweenFactorDouble(before.key, self.key, 0.0, noise)
