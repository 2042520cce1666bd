# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's pose in the body, estimated in the window.

A calibrated mounting is off by a degree or so, or the camera was bumped. The variable E(k) is
body_T_cam of the frames from state k to state l, the first for which there is another variable, at
least `window.camera_period` later. A random walk leads to the next one,

    E(l) = E(k) Exp(n),    n ~ N(0, Q (t_l - t_k)),

Q of the squares of `rotation_random_walk` and `translation_random_walk`.
"""

from dataclasses import dataclass
from typing import ClassVar

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import E
from typing_extensions import Self

from ruledgraph.backend.camera_variable import CameraVariable
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import Extrinsics
from ruledgraph.core.config import Config


@dataclass(eq=False)
class ExtrinsicsVariable(CameraVariable):
    """Variable of the camera's pose in the body in the frames of one `window.camera_period`."""

    SIZE: ClassVar[int] = 6

    body_T_cam: gtsam.Pose3
    """The estimate of E(k)."""
    covariance: FloatArray
    """Of that, as of the newest state whose frames it has, (6, 6)."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return E(self.index)

    @property
    def extrinsics(self) -> Extrinsics:
        """The estimate."""
        return Extrinsics(self.body_T_cam, self.covariance)

    def insert(self, values: gtsam.Values) -> None:
        """Add the estimate."""
        values.insert(self.key, self.body_T_cam)

    def read(self, estimate: gtsam.Values) -> None:
        """Take over what the smoother found."""
        self.body_T_cam = estimate.atPose3(self.key)

    def read_covariance(self, covariance: FloatArray) -> None:
        """Take over a marginal, (6, 6)."""
        self.covariance = covariance

    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""
        noise = noiseModel.Gaussian.Covariance(self.covariance)
        return gtsam.PriorFactorPose3(self.key, self.body_T_cam, noise)

    def random_walk_factor(self, before: Self, config: Config) -> gtsam.NonlinearFactor:
        """See the head of this file."""
        own = config.extrinsics
        sigmas = np.repeat([own.rotation_random_walk, own.translation_random_walk], 3)
        noise = noiseModel.Diagonal.Sigmas(sigmas * np.sqrt(self.time - before.time))
        return gtsam.BetweenFactorPose3(before.key, self.key, gtsam.Pose3(), noise)
