# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far the images moved a state from where the IMU had predicted it."""

from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.states import StateNode
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import Innovation

# Directions count in which the variance fell by this share: less is lost in linearisation.
_LEAST_GAIN = 0.1


class Prediction(NamedTuple):
    """A state as the IMU predicts it from the one before."""

    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    covariance: FloatArray
    """Of pose, velocity and bias, (15, 15)."""


def innovation(predicted: Prediction, found: StateNode) -> Innovation:
    """The normalised innovation squared that a state has taken up.

    With the prediction x- of covariance P- and the estimate x of covariance P, an update with the
    right noise figures moves the state by a sum of independent steps:

        x - x- ~ N(0, P- - P),    NIS = sum_i (u_i . (x - x-))^2 / gain_i,

    with u_i and gain_i from the eigenvectors of P- - P in coordinates in which P- is the identity.
    It is chi-square, with one degree of freedom for each direction in which the variance fell by a
    tenth or more; the others, such as place and heading, the images say nothing of.

    Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation
    (2001), 5.4; P- - P = K S K^T with the gain K and the innovation's covariance S.
    """
    before, after = predicted.state, found.state
    moved = np.concatenate(
        [
            before.pose().localCoordinates(after.pose()),
            after.velocity() - before.velocity(),
            found.bias.vector() - predicted.bias.vector(),
        ]
    )
    root = np.linalg.cholesky(predicted.covariance)
    whitened = np.linalg.solve(root, np.column_stack([found.covariance, moved]))
    remaining = np.linalg.solve(root, whitened[:, :-1].T)
    shares, axes = np.linalg.eigh(np.eye(len(moved)) - 0.5 * (remaining + remaining.T))
    told = shares > _LEAST_GAIN
    steps = axes[:, told].T @ whitened[:, -1]
    return Innovation(float(np.sum(steps**2 / shares[told])), int(np.count_nonzero(told)))
