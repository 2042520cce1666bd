# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Zero-velocity and no-motion factors while the body is at rest."""

from collections.abc import Sequence
from itertools import takewhile

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import V, X

from ruledgraph.backend.states import Interval
from ruledgraph.core.config import RestConfig


def resting(intervals: Sequence[Interval]) -> list[Interval]:
    """Those of the rest that goes on until the newest state, newest first."""
    return list(takewhile(lambda interval: interval.still, reversed(intervals)))


def rests_throughout(intervals: Sequence[Interval]) -> bool:
    """Whether the body rests all the window long."""
    return all(interval.still for interval in intervals)


def rest_factors(intervals: Sequence[Interval], config: RestConfig) -> list[gtsam.NonlinearFactor]:
    """Factors of the newest state, at the end of a rest that goes on: zero velocity, and no motion
    since the first state of the rest. They are also added to the newest interval.
    """
    rest = resting(intervals)
    if not rest:
        return []
    first, k = rest[-1].node.index, rest[0].node.index + 1
    slow = noiseModel.Isotropic.Sigma(3, config.velocity_sigma)
    near = noiseModel.Isotropic.Sigma(6, config.pose_sigma)
    factors: list[gtsam.NonlinearFactor] = [
        gtsam.PriorFactorVector(V(k), np.zeros(3), slow),
        gtsam.BetweenFactorPose3(X(first), X(k), gtsam.Pose3(), near),
    ]
    rest[0].imu_factors += factors
    return factors
