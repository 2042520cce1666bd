# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-ruled-surface factors for GTSAM graphs.

One function for each set of variables; the type of `points` chooses the residual. All return a
`gtsam.CustomFactor` with unwhitened residuals and GTSAM's tangent conventions (`Pose3`: rotation
first, right perturbation), so that they stand beside native factors in any graph.
"""

from typing import TypeAlias

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.factor import RuledSurfaceFactor
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion
from ruledgraph_factors.observations import GeometricPoints, ReprojectionPoints
from ruledgraph_factors.spec import Form, RuledSurfaceSpec
from ruledgraph_factors.validation import positive_number

Points: TypeAlias = GeometricPoints | ReprojectionPoints


def ruled_surface_factor(
    noise_model: noiseModel.Base,
    pose_key: int,
    velocity_key: int,
    bias_key: int,
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> RuledSurfaceFactor:
    """One line over all frames that follow a state, on that state and the line.

    Residual (default points): r = C_j m_j / |m_j,xy| for every frame j, with m_j the line's moment
    in the camera at R_j = R Exp(theta_j(b)), p_j = p + v t_j + g t_j^2 / 2 + R dp_j(b).

    Args:
        noise_model: of dimension `points.rows`, any kind, robust ones too. Units: normalised image
            coordinates of one point, that is pixels over focal length. At the truth the whitened
            squared norm is the number of points; a robust constant belongs above its root.
        pose_key: Pose3, world_T_body of the state.
        velocity_key: Vector3, of the body in the world, m/s.
        bias_key: imuBias.ConstantBias.
        line_key: Vector4, delta of `chart`.
        motion: of the frames in `points`, from `preintegrate_frames`.
        chart: of the line.
        points: the line's edge points: `GeometricPoints` for the geometric residual,
            `ReprojectionPoints` for the paper's.
        body_T_cam: camera pose in the body (IMU) frame, by default identity.
        gravity: in the world, m/s^2.

    Raises:
        FactorError: naming the argument that is wrong.

    Source: Zhu, Burner, Aloimonos, arXiv 2512.00327, Eq. 8 to 15, with the inertial motion
    expressed by a state.
    """
    keys = pose_key, velocity_key, bias_key, line_key
    return _factor("node", noise_model, keys, motion, chart, points, body_T_cam, gravity)


def ruled_surface_factor_with_time_offset(
    noise_model: noiseModel.Base,
    pose_key: int,
    velocity_key: int,
    bias_key: int,
    time_key: int,
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> RuledSurfaceFactor:
    """`ruled_surface_factor` with the clock of the frames as a variable.

    Takes `time_key` (double, s): how much later than `motion` says the frames were taken. The state
    stays where it is; the frames' poses move along the motion, to first order (see the module
    `motion`, which needs `preintegrate_frames(..., with_time=True)`): good for some milliseconds.
    Where the estimate comes out larger, compute the times of coming frames with it. For all else
    see `ruled_surface_factor`.

    Source: the frame's own motion in place of Li and Mourikis, "Online temporal calibration for
    camera-IMU systems", IJRR 2014, who shift the camera's pose likewise.
    """
    keys = pose_key, velocity_key, bias_key, time_key, line_key
    rest = motion, chart, points, body_T_cam, gravity
    return _factor("node_time_offset", noise_model, keys, *rest)


def ruled_surface_factor_with_extrinsics(
    noise_model: noiseModel.Base,
    pose_key: int,
    velocity_key: int,
    bias_key: int,
    extrinsics_key: int,
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> RuledSurfaceFactor:
    """`ruled_surface_factor` with the camera's pose in the body frame as a variable.

    Takes `extrinsics_key` (Pose3, body_T_cam) in place of `body_T_cam`; for all else see
    `ruled_surface_factor`. Each camera of a rig has a key of its own; all may see the same line.
    """
    keys = pose_key, velocity_key, bias_key, extrinsics_key, line_key
    return _factor("node_extrinsics", noise_model, keys, motion, chart, points, None, gravity)


def ruled_surface_factor_with_time_offset_and_extrinsics(
    noise_model: noiseModel.Base,
    pose_key: int,
    velocity_key: int,
    bias_key: int,
    time_key: int,
    extrinsics_key: int,
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> RuledSurfaceFactor:
    """`ruled_surface_factor` with both the clock of the frames and the camera's pose as variables.

    See `ruled_surface_factor_with_time_offset` and `ruled_surface_factor_with_extrinsics`.
    """
    keys = pose_key, velocity_key, bias_key, time_key, extrinsics_key, line_key
    rest = motion, chart, points, None, gravity
    return _factor("node_time_offset_extrinsics", noise_model, keys, *rest)


def ruled_surface_factor_with_gravity_direction(
    noise_model: noiseModel.Base,
    pose_key: int,
    velocity_key: int,
    bias_key: int,
    gravity_key: int,
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
    gravity_magnitude: float = -STANDARD_GRAVITY[2],
) -> RuledSurfaceFactor:
    """`ruled_surface_factor` with the direction of gravity as a variable.

    Takes `gravity_key` (Unit3, world gravity is magnitude times this direction: downwards) and
    `gravity_magnitude` (m/s^2), as GTSAM's `CombinedImuFactorWithGravityDirection`; for all else
    see `ruled_surface_factor`.
    """
    down = [0.0, 0.0, -positive_number("gravity_magnitude", gravity_magnitude)]
    keys = pose_key, velocity_key, bias_key, gravity_key, line_key
    rest = motion, chart, points, body_T_cam, down
    return _factor("node_gravity_direction", noise_model, keys, *rest)


def ruled_surface_factor_with_gravity_vector(
    noise_model: noiseModel.Base,
    pose_key: int,
    velocity_key: int,
    bias_key: int,
    gravity_key: int,
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
) -> RuledSurfaceFactor:
    """`ruled_surface_factor` with the whole gravity vector as a variable.

    Takes `gravity_key` (Vector3, world gravity in m/s^2), as GTSAM's
    `CombinedImuFactorWithGravityVector`; for all else see `ruled_surface_factor`.
    """
    keys = pose_key, velocity_key, bias_key, gravity_key, line_key
    return _factor("node_gravity_vector", noise_model, keys, motion, chart, points, body_T_cam)


def ruled_surface_pose_factor(
    noise_model: noiseModel.Base,
    pose_key: int,
    line_key: int,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
) -> RuledSurfaceFactor:
    """One line in one frame, for a graph that has a pose at every frame.

    `pose_key` (Pose3) is world_T_body, or world_T_cam without `body_T_cam`; `points` hold that one
    frame. For all else see `ruled_surface_factor`.
    """
    keys = pose_key, line_key
    rest = FrameMotion.at_rest()
    return _factor("pose", noise_model, keys, rest, chart, points, body_T_cam)


def ruled_surface_pose_factor_with_extrinsics(
    noise_model: noiseModel.Base,
    pose_key: int,
    extrinsics_key: int,
    line_key: int,
    chart: LineChart,
    points: Points,
) -> RuledSurfaceFactor:
    """`ruled_surface_pose_factor` with the camera's pose in the body frame as a variable.

    Takes `extrinsics_key` (Pose3, body_T_cam) in place of `body_T_cam`.
    """
    keys = pose_key, extrinsics_key, line_key
    return _factor("pose_extrinsics", noise_model, keys, FrameMotion.at_rest(), chart, points)


def _factor(
    form: Form,
    noise_model: noiseModel.Base,
    keys: tuple[int, ...],
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> RuledSurfaceFactor:
    spec = RuledSurfaceSpec(
        form=form,
        keys=keys,
        noise_model=noise_model,
        chart=chart,
        motion=motion,
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.asarray(gravity),
    )
    return RuledSurfaceFactor(spec)
