# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Position and yaw that no measurement shows, and how a segment takes them over from the last."""

from dataclasses import dataclass, field
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Covariances

_UP = np.array([0.0, 0.0, 1.0])


def heading(ours: FloatArray, other: FloatArray) -> gtsam.Rot3:
    """The turn about the vertical that best takes the other attitudes, (N, 3, 3), onto ours.

    Unlike a difference of yaw angles it exists for any mounting of the body.
    """
    M = np.einsum("nij,nkj->ik", ours, other)
    return gtsam.Rot3.Yaw(float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])))


@dataclass(frozen=True, eq=False)
class GaugeUncertainty:
    """Covariance of the unobservable position and yaw of a segment's world: what gaps between
    segments and faults have left, to be added to the window's marginals.
    """

    position: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    """Covariance in the world, m^2."""
    heading: float = 0.0
    """Variance, rad^2."""
    about: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Where the heading turns about."""

    def grown(self, position: FloatArray, heading: float, about: FloatArray) -> "GaugeUncertainty":
        """This and more of both; the heading turns about another position from now on."""
        arm = np.cross(_UP, about - self.about)
        by_heading = self.heading * np.outer(arm, arm)
        return GaugeUncertainty(
            self.position + by_heading + position, self.heading + heading, about
        )

    def added(
        self, covariances: Covariances, pose: gtsam.Pose3, velocity: FloatArray
    ) -> Covariances:
        """Covariances of a state with this in them."""
        of_pose, of_velocity, of_bias = covariances
        R = pose.rotation().matrix()
        of_pose = of_pose.copy()
        of_pose[3:, 3:] += R.T @ self.position @ R
        if self.heading == 0.0:
            return of_pose, of_velocity, of_bias
        arm = np.cross(_UP, pose.translation() - self.about)
        by_heading = np.concatenate([R.T @ _UP, R.T @ arm])
        of_pose += self.heading * np.outer(by_heading, by_heading)
        turned = np.cross(_UP, velocity)
        return of_pose, of_velocity + self.heading * np.outer(turned, turned), of_bias


class Ended(NamedTuple):
    """The last that was known of a segment."""

    time: float
    pose: gtsam.Pose3
    velocity: FloatArray
    covariances: Covariances


def continued(
    start: Start, ended: Ended, config: IntegrityConfig
) -> tuple[Start, GaugeUncertainty]:
    """A start in the world of the segment before it, and what the gap between them leaves open.

    The body goes on as it moved, for a while, and keeps its heading.
    """
    gap = max(start.time - ended.time, 0.0)
    attitude = ended.pose.rotation().matrix()
    turn = heading(attitude[None], start.state.attitude().matrix()[None])
    fading = config.gap_velocity_time * (1.0 - np.exp(-gap / config.gap_velocity_time))
    position = ended.pose.translation() + fading * ended.velocity
    shift = position - turn.rotate(start.state.position())
    of_pose, of_velocity, _ = ended.covariances
    unsure = (gap - fading) * ended.velocity
    open_position = (
        attitude @ of_pose[3:, 3:] @ attitude.T
        + of_velocity * gap**2
        + np.outer(unsure, unsure)
        + np.eye(3) * (0.5 * config.gap_acceleration * gap**2) ** 2
    )
    up = attitude.T @ _UP
    open_heading = float(up @ of_pose[:3, :3] @ up) + (config.gap_turn_rate * gap) ** 2
    return start.moved(gtsam.Pose3(turn, shift)), GaugeUncertainty(
        open_position, open_heading, position
    )
