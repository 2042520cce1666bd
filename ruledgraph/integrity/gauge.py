# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of the unobservable position and yaw, and how a segment continues the last one."""

from dataclasses import dataclass, field
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Covariances

UP = np.array([0.0, 0.0, 1.0])


def yaw_alignment(ours: FloatArray, other: FloatArray) -> gtsam.Rot3:
    """The rotation about the vertical that best aligns other attitudes, (N, 3, 3), with ours.

    Unlike a difference of yaw angles it exists for any mounting of the body.
    """
    M = np.einsum("nij,nkj->ik", ours, other)
    return gtsam.Rot3.Yaw(float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])))


@dataclass(frozen=True, eq=False)
class GaugeUncertainty:
    """Covariance of the unobservable position and yaw of a segment's world: what gaps between
    segments and faults have left, to be added to the window's marginals.
    """

    position_covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    """In the world, m^2."""
    yaw_variance: float = 0.0
    """rad^2."""
    pivot: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Position that does not move with the yaw, (3,), m."""

    def inflated(
        self, position_covariance: FloatArray, yaw_variance: float, pivot: FloatArray
    ) -> "GaugeUncertainty":
        """More of both, with another pivot from now on."""
        arm = np.cross(UP, pivot - self.pivot)
        by_yaw = self.yaw_variance * np.outer(arm, arm)
        position_covariance = self.position_covariance + by_yaw + position_covariance
        return GaugeUncertainty(position_covariance, self.yaw_variance + yaw_variance, pivot)

    def added_to(
        self, covariances: Covariances, pose: gtsam.Pose3, velocity: FloatArray
    ) -> Covariances:
        """Covariances of a state plus this."""
        of_pose, of_velocity, of_bias = covariances
        R = pose.rotation().matrix()
        of_pose = of_pose.copy()
        of_pose[3:, 3:] += R.T @ self.position_covariance @ R
        if self.yaw_variance == 0.0:
            return of_pose, of_velocity, of_bias
        arm = np.cross(UP, pose.translation() - self.pivot)
        by_yaw = np.concatenate([R.T @ UP, R.T @ arm])
        of_pose += self.yaw_variance * np.outer(by_yaw, by_yaw)
        turned = np.cross(UP, velocity)
        return of_pose, of_velocity + self.yaw_variance * np.outer(turned, turned), of_bias


class ReliableState(NamedTuple):
    """The last state of a segment whose lines fitted."""

    time: float
    pose: gtsam.Pose3
    velocity: FloatArray
    covariances: Covariances


def continued(
    start: Start, last: ReliableState, config: IntegrityConfig
) -> tuple[Start, GaugeUncertainty]:
    """A start in the world of the segment before it, and the gauge uncertainty that the gap adds.

    The body is taken to keep its velocity for a while, and its heading.
    """
    gap = max(start.time - last.time, 0.0)
    attitude = last.pose.rotation().matrix()
    rotation = yaw_alignment(attitude[None], start.state.attitude().matrix()[None])
    fading = config.gap_velocity_time * (1.0 - np.exp(-gap / config.gap_velocity_time))
    position = last.pose.translation() + fading * last.velocity
    translation = position - rotation.rotate(start.state.position())
    of_pose, of_velocity, _ = last.covariances
    unknown = (gap - fading) * last.velocity
    position_covariance = (
        attitude @ of_pose[3:, 3:] @ attitude.T
        + of_velocity * gap**2
        + np.outer(unknown, unknown)
        + np.eye(3) * (0.5 * config.gap_acceleration * gap**2) ** 2
    )
    up = attitude.T @ UP
    yaw_variance = float(up @ of_pose[:3, :3] @ up) + (config.gap_rotation_rate * gap) ** 2
    return start.moved(gtsam.Pose3(rotation, translation)), GaugeUncertainty(
        position_covariance, yaw_variance, position
    )
