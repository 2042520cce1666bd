# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far the images moved a state from where the IMU had predicted it, some time before."""

import math

import gtsam
import numpy as np

from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.estimates import Innovation
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import StateWithCovariance, propagated_covariances
from ruledgraph_factors import FrameMotion

# Directions count in which the variance fell by this share: less is lost in linearisation.
_MIN_GAIN = 0.1


class Prediction:
    """A state as it was estimated when it was new, carried on by the IMU alone."""

    def __init__(self, node: StateNode) -> None:
        self.since = self.time = node.time
        """When it was estimated, and how far it was carried, s."""
        self.state = node.state
        self.bias = node.bias
        self.covariance = node.covariance

    def carry_on(self, motion: FrameMotion, time: float, imu: ImuBuffer, noise: ImuNoise) -> None:
        """By a motion to one frame, at a time, s."""
        covariance = propagated_covariances(self, motion, imu, noise)[0]
        pose = motion.poses(self.state, self.bias, imu.gravity)[0]
        velocity = motion.velocities(self.state, self.bias, imu.gravity)[0]
        self.state, self.time, self.covariance = gtsam.NavState(pose, velocity), time, covariance


class ImuPredictions:
    """Of the newest state, from the states up to so long before it.

    Over that time the IMU's slow errors show (bias, scale), of which from one state to the next
    there is nothing to be seen beside the noise of edges. Scale errors, for which the graph lets
    the biases walk further, are not in the noise here, so that they do show.

    Args:
        longest: of the time that the IMU carries one, s.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._predictions: list[Prediction] = []
        self._begin = -math.inf

    def begin_at(self, node: StateNode) -> None:
        """Predict from a state on that was solved for."""
        if node.time >= self._begin:
            self._predictions.append(Prediction(node))

    def restart(self, time: float) -> None:
        """After a jump of the biases at a time, s: for as long, most of a prediction's covariance
        is the jump's, and an innovation tells nothing of the noise.
        """
        self._predictions.clear()
        self._begin = time + self._longest

    def carry_on(self, interval: Interval, time: float, imu: ImuBuffer, noise: ImuNoise) -> None:
        """To a new state, at a time (s), at the end of an interval."""
        self._predictions = [p for p in self._predictions if time - p.since <= self._longest]
        motion = interval.motion.select([-1])
        for prediction in self._predictions:
            prediction.carry_on(motion, time, imu, noise)

    def innovation(self, found: StateNode) -> Innovation | None:
        """Of the newest state against its oldest prediction; None where there is none, or where a
        covariance is none, as when the smoother has failed.
        """
        if not self._predictions:
            return None
        oldest = self._predictions[0]
        try:
            return innovation(oldest, found, oldest.since)
        except np.linalg.LinAlgError:
            return None


def innovation(
    predicted: StateWithCovariance, found: StateWithCovariance, since: float
) -> Innovation:
    """The normalised innovation squared that a state has taken up.

    With the prediction x- of covariance P- and the estimate x of covariance P, updates with the
    right noise figures move the state by a sum of independent steps:

        x - x- ~ N(0, P- - P),    NIS = sum_i (u_i . (x - x-))^2 / gain_i,

    with u_i and gain_i from the eigenvectors of P- - P in coordinates in which P- is the identity.
    It is chi-square, with one degree of freedom for each direction in which the variance fell by a
    tenth or more; the others, such as position and yaw, the images say nothing of. `since` (s) is
    when the prediction began.

    Raises:
        numpy.linalg.LinAlgError: when P- is not positive definite.

    Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation
    (2001), 5.4; P- - P is the sum of K S K^T over the updates between them, with the gain K and
    the innovation's covariance S.
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
    observed = shares > _MIN_GAIN
    steps = axes[:, observed].T @ whitened[:, -1]
    nis = float(np.sum(steps**2 / shares[observed]))
    return Innovation(nis, int(np.count_nonzero(observed)), since)
