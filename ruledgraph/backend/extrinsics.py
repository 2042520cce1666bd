# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's pose in the body, estimated in the window.

A calibrated mounting is off by a degree or so, or the camera was bumped. The variable E(k) is
body_T_cam of the frames after state k. A single one for all frames would stay linearised where it
was when its first neighbours left the window; so each interval has its own, tied to the last by

    E(k) = E(k-1) Exp(n),    n ~ N(0, diag(rotation_walk^2, translation_walk^2) (t_k - t_{k-1})).
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import E

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.extrinsics import Extrinsics


@dataclass(eq=False)
class ExtrinsicsState:
    """Variable of the camera's pose in the body in one interval's frames."""

    index: int
    """k, of its state."""
    time: float
    """Of that state, s."""
    body_T_cam: gtsam.Pose3
    """The estimate of E(k)."""
    covariance: FloatArray
    """Of that, when it was new, (6, 6)."""

    @property
    def key(self) -> int:
        """Of its variable."""
        return E(self.index)

    @property
    def extrinsics(self) -> Extrinsics:
        """The estimate."""
        return Extrinsics(self.body_T_cam, self.covariance)

    def prior(self) -> gtsam.NonlinearFactor:
        """Prior on the first one of a window."""
        noise = noiseModel.Gaussian.Covariance(self.covariance)
        return gtsam.PriorFactorPose3(self.key, self.body_T_cam, noise)

    def random_walk_factor(
        self, before: "ExtrinsicsState", rotation_walk: float, translation_walk: float
    ) -> gtsam.NonlinearFactor:
        """See the head of this file; the walks in rad/sqrt(s) and m/sqrt(s)."""
        sigmas = np.repeat([rotation_walk, translation_walk], 3)
        noise = noiseModel.Diagonal.Sigmas(sigmas * np.sqrt(self.time - before.time))
        return gtsam.BetweenFactorPose3(before.key, self.key, gtsam.Pose3(), noise)
