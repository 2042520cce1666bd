# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The arithmetic of the point-to-ruled-surface residuals: arrays in, arrays out.

This is the reference; `factors/include/ruledgraph/ruled_surface.hpp` computes the same natively.

For every frame of an interval the line is brought into the camera,

    m = R_c^T (m_w - p_c x v_w),    d = R_c^T v_w / |v_w|,

and compared with the edge points in one of two ways:

- *geometric*: the exact distance of a point (x, y, 1) to the projected ruling, p . m / |m_xy|. All
  points of a frame act through their triangular statistic C: three rows r = C m / |m_xy|.
- *reprojection*, the paper's (Zhu, Burner, Aloimonos, arXiv 2512.00327, Eq. 12 to 15): with a point
  S on the line, P = p d_z - d_xy, Phi = S_xy - p S_z and alpha = P . Phi / P . P,
  r = p - (S + alpha d)_xy / (S + alpha d)_z, two rows a point.

The columns of a Jacobian are, in this order, the tangents of pose (6), velocity (3), bias (6),
gravity (3) and line (4); of a motion with a `time_jacobian` also the frames' shift in time (1), and
last, of a state with a `focal_ratio`, that of it (1).

A camera whose focal length is s times the one that points were normalised with has the images of a
space that is stretched by D = diag(s, s, 1): m becomes (m_x, m_y, s m_z), S and d become D S and
D d. So the noise of points is one in pixels, which s does not change. Both focal lengths have the
same ratio, and distortion is that of the given ones.
"""

from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.validation import FloatArray, IntArray

COLUMNS, COLUMNS_WITH_TIME, EXTRINSICS_COLUMNS, FOCAL_COLUMNS = 22, 23, 6, 1
LINE_COLUMNS = slice(18, 22)
# A ruling with |m_xy| below this (for a unit Pluecker pair) has no finite image line: the camera's
# centre lies on the line, or the line lies in the camera's focal plane.
NO_RULING = 1e-9
# GTSAM's projection factors give a point behind the camera this constant residual, too.
BEHIND_CAMERA_RESIDUAL = 2.0
_NEGLIGIBLE_DEPTH = 1e-9
_END_ON = 1e-18
_AXIS_HATS = hat(np.eye(3)[:2])


class State(NamedTuple):
    """What a factor depends on."""

    world_T_body: FloatArray
    """Pose of the state, (4, 4)."""
    velocity: FloatArray
    """Of the body in the world, (3,), m/s."""
    bias: FloatArray
    """Accelerometer and gyroscope, (6,)."""
    gravity: FloatArray
    """In the world, (3,), m/s^2."""
    line: FloatArray
    """Delta of the chart, (4,)."""
    time_shift: float = 0.0
    """How much later than their motion says the frames were taken, s; it has a `time_jacobian`."""
    body_T_cam: FloatArray | None = None
    """The camera's pose in the body, (4, 4), where it is a variable."""
    focal_ratio: float | None = None
    """Of the camera's focal length to the one that points were normalised with, where it is a
    variable."""


class CameraLine(NamedTuple):
    """A line in each of n cameras, up to the common scale of its unit Pluecker pair."""

    moment: FloatArray
    """(n, 3); as an image line, (a, b, c) of a x + b y + c = 0."""
    direction: FloatArray
    """Unit, (n, 3)."""
    sign: float
    """The sign of sin(phi), which `moment` carries as a common factor: +1 or -1."""
    d_moment: FloatArray | None
    """(n, 3, 22 or 23)."""
    d_direction: FloatArray | None
    """(n, 3, 22 or 23)."""


class Residual(NamedTuple):
    """Unwhitened residual (rows,) and Jacobian (rows, columns), None when not asked for."""

    value: FloatArray
    jacobian: FloatArray | None


class Geometry:
    """The constants that bring a line into the cameras of an interval, as arrays."""

    def __init__(self, chart: LineChart, motion: FrameMotion, body_T_cam: gtsam.Pose3) -> None:
        self.chart = chart
        self.motion = motion
        self.world_R_anchor = chart.world_T_anchor.rotation().matrix()
        self.world_t_anchor = chart.world_T_anchor.translation()
        self.body_R_cam = body_T_cam.rotation().matrix()
        self.body_t_cam = body_T_cam.translation()

    def line_in_cameras(self, state: State, want_jacobian: bool) -> CameraLine:
        """The line in every frame's camera."""
        frames = self.motion.predict(
            state.world_T_body[:3, :3],
            state.world_T_body[:3, 3],
            state.velocity,
            state.bias,
            state.gravity,
            want_jacobian,
            state.time_shift,
        )
        u, phi, right_jacobian = self.chart.frame(state.line)
        cosine, sine = float(np.cos(phi)), float(np.sin(phi))
        normal, along, _ = (self.world_R_anchor @ u).T

        body_R_world = frames.rotation.transpose(0, 2, 1)
        cam_R_world = self.body_R_cam.T @ body_R_world
        centre = frames.position + frames.rotation @ self.body_t_cam
        lever = hat(self.world_t_anchor - centre)
        world_moment = cosine * normal + sine * (lever @ along)
        moment = (cam_R_world @ world_moment[..., None])[..., 0]
        direction = cam_R_world @ along
        sign = 1.0 if sine >= 0.0 else -1.0
        if frames.jacobian is None:
            return CameraLine(moment, direction, sign, None, None)

        # By each frame's own pose: right perturbation (rotation w, translation t) of the body.
        cam_R_body = self.body_R_cam.T
        body_moment = (body_R_world @ world_moment[..., None])[..., 0]
        body_direction = body_R_world @ along
        across = hat(body_direction)
        by_pose = np.empty((len(self.motion), 6, 6))
        by_pose[:, :3, :3] = hat(body_moment) - sine * across @ hat(self.body_t_cam)
        by_pose[:, :3, 3:] = sine * across
        by_pose[:, 3:, :3] = across
        by_pose[:, 3:, 3:] = 0.0

        # By the line: u1 and u2 turn with w = Jr delta, phi grows with delta[0].
        d_normal, d_along = -self.world_R_anchor @ u @ _AXIS_HATS @ right_jacobian
        d_world_moment = np.empty((len(self.motion), 3, 4))
        d_world_moment[..., 1:] = cosine * d_normal + sine * lever @ d_along
        d_world_moment[..., 0] = -sine * normal + cosine * (lever @ along)

        by_motion = by_pose @ frames.jacobian
        by_motion[:, :3] = cam_R_body @ by_motion[:, :3]
        by_motion[:, 3:] = cam_R_body @ by_motion[:, 3:]
        jacobian = np.zeros((len(self.motion), 6, by_motion.shape[-1] + 4))
        jacobian[..., :18], jacobian[..., 22:] = by_motion[..., :18], by_motion[..., 18:]
        jacobian[:, :3, LINE_COLUMNS] = cam_R_world @ d_world_moment
        jacobian[:, 3:, 19:22] = cam_R_world @ d_along
        return CameraLine(moment, direction, sign, jacobian[:, :3], jacobian[:, 3:])


def geometric_residual(
    line: CameraLine, statistics: FloatArray, focal_ratio: float | None = None
) -> Residual:
    """Compressed distances of the points to the projected ruling, C m / |m_xy|: (3n,).

    A frame without a finite ruling (see `NO_RULING`) carries no information: zero rows. Which side
    of the camera the line is on makes no difference.

    Args:
        line: in the n cameras.
        statistics: C of each frame, (n, 3, 3), of `GeometricPoints`.
        focal_ratio: s, where it is a variable: the Jacobian has a column more.
    """
    size = np.hypot(line.moment[:, 0], line.moment[:, 1])
    visible = size > NO_RULING
    inverse = np.where(visible, 1.0 / np.where(visible, size, 1.0), 0.0)[:, None]
    unit = line.moment * inverse
    by_ratio = (statistics[:, :, 2] * unit[:, 2:]).reshape(-1, 1)
    if focal_ratio is not None:
        statistics = statistics * [1.0, 1.0, focal_ratio]
    value = (statistics @ unit[..., None]).reshape(-1)
    if line.d_moment is None:
        return Residual(value, None)
    # d (m / |m_xy|) = (I - unit (unit_x, unit_y, 0)) dm / |m_xy|
    projector = np.zeros((len(unit), 3, 3))
    projector[:] = np.eye(3)
    projector[:, :, :2] -= unit[:, :, None] * unit[:, None, :2]
    jacobian = (statistics @ projector * inverse[..., None]) @ line.d_moment
    jacobian = jacobian.reshape(value.size, -1)
    if focal_ratio is not None:
        jacobian = np.hstack([jacobian, by_ratio])
    return Residual(value, jacobian)


def reprojection_residual(
    line: CameraLine,
    points: FloatArray,
    sqrt_weights: FloatArray,
    frame: IntArray,
    focal_ratio: float | None = None,
) -> Residual:
    """The paper's ruling reprojection error with alpha in closed form: (2N,), two rows a point.

    Positive depth: a point whose foot on the ruling does not lie in front of its camera has the
    constant residual (2, 2) and zero derivative. As with GTSAM's projection factors there is no
    slope that leads back. A ruling seen end-on in the very point has zero residual and derivative
    by definition: the residual is discontinuous there.

    Args:
        line: in the n cameras.
        points: of all frames, (N, 2).
        sqrt_weights: (N,).
        frame: the index of each point's frame, (N,).
        focal_ratio: s, where it is a variable: the Jacobian has a column more.
    """
    # S = d x m is the point of the line closest to the camera's centre, times sin(phi): the common
    # factor keeps a line at infinity regular and leaves alpha's foot in the same place.
    stretch = np.array([1.0, 1.0, 1.0]) if focal_ratio is None else [focal_ratio, focal_ratio, 1.0]
    in_camera = np.cross(line.direction, line.moment)[frame], line.direction[frame]
    closest, direction = (vector * stretch for vector in in_camera)
    p_matrix = points * direction[:, 2:] - direction[:, :2]
    phi = closest[:, :2] - points * closest[:, 2:]
    pp = np.sum(p_matrix * p_matrix, axis=1)
    regular = ~(pp <= _END_ON)  # NaN goes on to the residual
    safe_pp = np.where(regular, pp, 1.0)
    alpha = np.sum(p_matrix * phi, axis=1) / safe_pp
    foot = closest + alpha[:, None] * direction
    depth = foot[:, 2] * line.sign
    behind = regular & (depth <= _NEGLIGIBLE_DEPTH)
    valid = regular & ~behind
    inverse = np.where(valid, 1.0 / np.where(valid, foot[:, 2], 1.0), 0.0)
    projected = foot[:, :2] * inverse[:, None]
    value = np.where(valid[:, None], points - projected, 0.0)
    value[behind] = BEHIND_CAMERA_RESIDUAL
    value = (value * sqrt_weights[:, None]).reshape(-1)
    if line.d_moment is None or line.d_direction is None:
        return Residual(value, None)

    d_closest = (hat(line.direction) @ line.d_moment - hat(line.moment) @ line.d_direction)[frame]
    d_direction = line.d_direction[frame]
    if focal_ratio is not None:
        d_closest, d_direction = (
            np.concatenate(
                [d * np.reshape(stretch, (3, 1)), (vector * [1, 1, 0])[..., None]], axis=2
            )
            for d, vector in zip((d_closest, d_direction), in_camera, strict=True)
        )
    d_p_matrix = points[..., None] * d_direction[:, 2:] - d_direction[:, :2]
    d_phi = d_closest[:, :2] - points[..., None] * d_closest[:, 2:]
    # d alpha = (Phi . dP + P . dPhi - 2 alpha P . dP) / P . P
    bracket = phi - 2.0 * alpha[:, None] * p_matrix
    d_alpha = np.einsum("ni,nij->nj", bracket, d_p_matrix)
    d_alpha += np.einsum("ni,nij->nj", p_matrix, d_phi)
    d_alpha /= safe_pp[:, None]
    d_foot = d_closest + alpha[:, None, None] * d_direction
    d_foot += direction[:, :, None] * d_alpha[:, None, :]
    scale = (sqrt_weights * inverse)[:, None, None]
    jacobian = -scale * (d_foot[:, :2] - projected[..., None] * d_foot[:, 2:])
    return Residual(value, jacobian.reshape(value.size, -1))
