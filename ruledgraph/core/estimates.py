# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What comes out of an odometry: estimates of frames, and lines."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import gtsam

from ruledgraph.calibration.sensors import FloatArray
from ruledgraph.core.time_offset import NO_OFFSET, TimeOffset

Covariances: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Of pose (6, 6), velocity (3, 3) and bias (6, 6)."""


def blocks(covariance: FloatArray) -> Covariances:
    """The blocks of pose, velocity and bias of a joint covariance, (15, 15)."""
    return covariance[:6, :6], covariance[6:9, 6:9], covariance[9:, 9:]


Status = Literal["tracking", "still", "dead reckoning", "doubtful"]


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known of one frame."""

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
    at_knot: bool
    """Whether the frame is a knot's, optimised with all before it, or predicted from one."""
    segment: int = 0
    """Counts from 0; between two of them there is a gap or a failure."""
    time_offset: TimeOffset = NO_OFFSET
    """t_imu - t_cam, s, as of the last knot; without deviation where it is not estimated."""


@dataclass(frozen=True, eq=False)
class LineEstimate:
    """A line as it left the window."""

    number: int
    ends: FloatArray
    """In the world, (2, 3), m."""
    covariance: FloatArray
    """Of each end, (2, 3, 3), m^2."""
    first_stamp: int
    last_stamp: int
    points: int
    """Edge points that went into it."""
