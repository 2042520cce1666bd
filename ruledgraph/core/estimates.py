# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What comes out of an odometry: estimates of frames, and lines."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import NO_OFFSET, TimeOffset
from ruledgraph.core.trajectory import quaternion_xyzw

Covariances: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Of pose (6, 6), velocity (3, 3) and bias (6, 6)."""


def blocks(covariance: FloatArray) -> Covariances:
    """The blocks of pose, velocity and bias of a joint covariance, (15, 15)."""
    return covariance[:6, :6], covariance[6:9, 6:9], covariance[9:, 9:]


class Innovation(NamedTuple):
    """How far the images, or a rest, moved a state from where the IMU alone carries the state of
    `integrity.innovation_span` before, or the segment's first one, or the first one that long after
    the biases' last jump, whichever is the latest.
    """

    nis: float
    """Normalised innovation squared: chi-square with `dof` degrees of freedom where the noise
    figures of IMU and edges are right."""
    dof: int
    """Directions of the state that they observe."""
    since: float
    """Time of the state that is carried, s."""


def nis_per_dof(innovations: Iterable[Innovation]) -> float | None:
    """Their mean NIS per degree of freedom, 1 where the noise figures are right; None of none."""
    found = list(innovations)
    dof = sum(innovation.dof for innovation in found)
    return sum(innovation.nis for innovation in found) / dof if dof else None


Status = Literal["tracking", "still", "dead reckoning", "degraded"]


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known of one frame: GTSAM's objects, and the same as numpy arrays.

    The body frame is the IMU's; the world's z axis points up. `matrix`, `position` and
    `quaternion_xyzw` are of world_T_body, which maps body coordinates to the world.
    """

    stamp: int
    """ns, the frame's own."""
    world_T_body: gtsam.Pose3
    velocity: FloatArray
    """Of the body in the world, (3,), m/s."""
    bias: gtsam.imuBias.ConstantBias
    covariances: Covariances
    """Of pose (6, 6), velocity (3, 3) and bias (6, 6)."""
    lines: int
    """Lines of the graph that were seen in the frame."""
    status: Status
    at_state: bool
    """Whether the frame is a state's, optimised with all before it, or predicted from one."""
    segment: int = 0
    """Counts from 0; between two of them there is a gap or a failure."""
    time_offset: TimeOffset = NO_OFFSET
    """t_imu - t_cam, s, as of the last state; sigma 0 where it is not estimated."""
    innovation: Innovation | None = None
    """Of a state when it was new; None of other frames, of a segment's first state, of smoothed
    estimates, of states at rest that were not solved for, and for `integrity.innovation_span` after
    the biases jumped."""

    @property
    def time(self) -> float:
        """The stamp in seconds; float64 rounds stamps of today to 0.2 microseconds."""
        return self.stamp * 1e-9

    @property
    def matrix(self) -> FloatArray:
        """world_T_body, (4, 4)."""
        return np.asarray(self.world_T_body.matrix())

    @property
    def position(self) -> FloatArray:
        """Of the body in the world, (3,), m."""
        return np.asarray(self.world_T_body.translation())

    @property
    def quaternion_xyzw(self) -> FloatArray:
        """World_R_body as a unit quaternion, (4,)."""
        return quaternion_xyzw(self.world_T_body)

    @property
    def gyroscope_bias(self) -> FloatArray:
        """In the body frame, (3,), rad/s."""
        return np.asarray(self.bias.gyroscope())

    @property
    def accelerometer_bias(self) -> FloatArray:
        """In the body frame, (3,), m/s^2."""
        return np.asarray(self.bias.accelerometer())

    @property
    def pose_covariance(self) -> FloatArray:
        """Of GTSAM's tangent at `world_T_body`, (6, 6): rotation (rad), then position (m), both in
        the body frame.
        """
        return self.covariances[0]

    @property
    def rotation_covariance(self) -> FloatArray:
        """Of the rotation vector in the body frame, (3, 3), rad^2."""
        return self.covariances[0][:3, :3]

    @property
    def position_covariance(self) -> FloatArray:
        """In the world frame, (3, 3), m^2."""
        R = self.world_T_body.rotation().matrix()
        return np.asarray(R @ self.covariances[0][3:, 3:] @ R.T)

    @property
    def velocity_covariance(self) -> FloatArray:
        """In the world frame, (3, 3), m^2/s^2."""
        return self.covariances[1]

    @property
    def gyroscope_bias_covariance(self) -> FloatArray:
        """(3, 3), rad^2/s^2."""
        return self.covariances[2][3:, 3:]

    @property
    def accelerometer_bias_covariance(self) -> FloatArray:
        """(3, 3), m^2/s^4."""
        return self.covariances[2][:3, :3]


@dataclass(frozen=True, eq=False)
class LineEstimate:
    """A line as it left the window."""

    id: int
    ends: FloatArray
    """In the world, (2, 3), m."""
    joint_covariance: FloatArray
    """Of both ends, (6, 6), m^2, of rank 4: the line's own four degrees of freedom."""
    first_stamp: int
    last_stamp: int
    points: int
    """Edge points that went into it."""
    segment: int = 0
    """Of the trajectory, in whose world it is."""
    sightings: int = 1
    """How often it came into view, as far as these were found to be one line."""

    @property
    def covariance(self) -> FloatArray:
        """Of each end, (2, 3, 3), m^2."""
        return np.stack([self.joint_covariance[:3, :3], self.joint_covariance[3:, 3:]])
