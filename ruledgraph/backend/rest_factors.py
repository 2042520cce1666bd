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


def rest_factors(
    intervals: Sequence[Interval], now: float, config: RestConfig
) -> list[gtsam.NonlinearFactor]:
    """Factors of a rest that lasts until the newest state, at time `now`, on the newest of its
    states that is old enough, unless it has them: zero velocity, and no motion since the first
    state of the rest. They are also kept in the interval that ends there, or begins, for a smoother
    that is begun anew.

    Where the IMU was not relied on in one of the last two intervals they are on the newest state:
    the biases are hardly known.
    """
    rest = resting(intervals)
    if any(interval.is_rest_despite_imu for interval in rest[:2]):
        part, k = rest[0], rest[0].node.index + 1
    else:
        middle = next((part for part in rest if part.node.time <= now - config.settle_time), None)
        if middle is None:
            return []
        part, k = middle, middle.node.index
    if V(k) in _zero_velocities(rest):
        return []
    first = rest[-1].node.index
    slow = noiseModel.Isotropic.Sigma(3, config.velocity_sigma)
    factors: list[gtsam.NonlinearFactor] = [gtsam.PriorFactorVector(V(k), np.zeros(3), slow)]
    if k > first:
        near = noiseModel.Isotropic.Sigma(6, config.pose_sigma)
        factors.append(gtsam.BetweenFactorPose3(X(first), X(k), gtsam.Pose3(), near))
    part.rest_factors += factors
    return factors


def _zero_velocities(rest: Sequence[Interval]) -> set[int]:
    """Variables that are known to be zero already."""
    of_rest = (factor for part in rest for factor in part.rest_factors)
    return {f.keys()[0] for f in of_rest if isinstance(f, gtsam.PriorFactorVector)}
