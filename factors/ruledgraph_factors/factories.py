# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-ruled-surface factors for GTSAM graphs.

One function for each set of variables; the type of `points` chooses the residual. All return a
`gtsam.CustomFactor` with unwhitened residuals and GTSAM's tangent conventions (`Pose3`: rotation
first, right perturbation), so that they stand beside native factors in any graph.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeAlias

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.factor import RuledSurfaceFactor
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion
from ruledgraph_factors.observations import GeometricPoints, ReprojectionPoints
from ruledgraph_factors.spec import CameraVariable, Form, RuledSurfaceSpec
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
    *,
    time_key: int | None = None,
    extrinsics_key: int | None = None,
    focal_key: int | None = None,
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
        time_key: double, s: how much later than `motion` says the frames were taken. The state
            stays where it is; the frames' poses move along the motion, to first order (see the
            module `motion`, which needs `preintegrate_frames(..., with_time=True)`): good for some
            milliseconds. Where the estimate comes out larger, compute the times of coming frames
            with it.
        extrinsics_key: Pose3, `body_T_cam` as a variable. Each camera of a rig has a key of its
            own; all may see the same line.
        focal_key: double: the camera's focal length over the one that points were normalised with,
            about 1. Both focal lengths change by it; distortion is that of the given ones.

    The keys of the factor: pose, velocity, bias, then time, extrinsics and focal length as far as
    there are keys of them, and the line.

    Raises:
        FactorError: naming the argument that is wrong.

    Source: Zhu, Burner, Aloimonos, arXiv 2512.00327, Eq. 8 to 15, with the inertial motion
    expressed by a state; for the time, the frame's own motion in place of Li and Mourikis, "Online
    temporal calibration for camera-IMU systems", IJRR 2014, who shift the camera's pose likewise.
    """
    of_camera: dict[CameraVariable, int | None] = {
        "time": time_key,
        "extrinsics": extrinsics_key,
        "focal": focal_key,
    }
    keys = pose_key, velocity_key, bias_key
    rest = motion, chart, points, body_T_cam, gravity, of_camera
    return _factor("node", noise_model, keys, line_key, *rest)


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
    keys = pose_key, velocity_key, bias_key, gravity_key
    rest = motion, chart, points, body_T_cam, down
    return _factor("node_gravity_direction", noise_model, keys, line_key, *rest)


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
    keys = pose_key, velocity_key, bias_key, gravity_key
    rest = motion, chart, points, body_T_cam
    return _factor("node_gravity_vector", noise_model, keys, line_key, *rest)


def ruled_surface_pose_factor(
    noise_model: noiseModel.Base,
    pose_key: int,
    line_key: int,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
    *,
    extrinsics_key: int | None = None,
    focal_key: int | None = None,
) -> RuledSurfaceFactor:
    """One line in one frame, for a graph that has a pose at every frame.

    `pose_key` (Pose3) is world_T_body, or world_T_cam without `body_T_cam`; `points` hold that one
    frame. For all else see `ruled_surface_factor`.
    """
    of_camera: dict[CameraVariable, int | None] = {"extrinsics": extrinsics_key, "focal": focal_key}
    rest = FrameMotion.at_rest(), chart, points, body_T_cam
    return _factor("pose", noise_model, (pose_key,), line_key, *rest, of_camera=of_camera)


def _factor(
    form: Form,
    noise_model: noiseModel.Base,
    keys: tuple[int, ...],
    line_key: int,
    motion: FrameMotion,
    chart: LineChart,
    points: Points,
    body_T_cam: gtsam.Pose3 | None = None,
    gravity: ArrayLike = STANDARD_GRAVITY,
    of_camera: Mapping[CameraVariable, int | None] = MappingProxyType({}),
) -> RuledSurfaceFactor:
    variables = {name: key for name, key in of_camera.items() if key is not None}
    if "extrinsics" in variables and body_T_cam is not None:
        raise FactorError("body_T_cam is the variable of extrinsics_key: pass one of the two")
    spec = RuledSurfaceSpec(
        form=form,
        keys=(*keys, *variables.values(), line_key),
        noise_model=noise_model,
        chart=chart,
        motion=motion,
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.asarray(gravity),
        camera_variables=tuple(variables),
    )
    return RuledSurfaceFactor(spec)
