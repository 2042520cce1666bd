# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-ruled-surface factors for GTSAM graphs.

One function for each set of variables; the type of `points` chooses the residual. All return a
`gtsam.CustomFactor` with unwhitened residuals and GTSAM's tangent conventions (`Pose3`: rotation
first, right perturbation), so that they stand beside native factors in any graph.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion
from ruledgraph_factors.observations import CompressedPoints, IndividualPoints
from ruledgraph_factors.ruled_surface import (
    COLUMNS,
    COLUMNS_WITH_TIME,
    Geometry,
    Residual,
    State,
)
from ruledgraph_factors.spec import Form, RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray, positive_number

Points = CompressedPoints | IndividualPoints

_POSE, _VELOCITY, _BIAS = slice(0, 6), slice(6, 9), slice(9, 15)
_GRAVITY, _LINE, _TIME = slice(15, 18), slice(18, 22), slice(22, 23)
_NO_VELOCITY, _NO_BIAS = np.zeros(3), np.zeros(6)
# The columns of the residual's Jacobian that belong to each key.
_COLUMNS: dict[Form, tuple[slice, ...]] = {
    "knot": (_POSE, _VELOCITY, _BIAS, _LINE),
    "knot_time_offset": (_POSE, _VELOCITY, _BIAS, _TIME, _LINE),
    "knot_gravity_direction": (_POSE, _VELOCITY, _BIAS, _GRAVITY, _LINE),
    "knot_gravity_vector": (_POSE, _VELOCITY, _BIAS, _GRAVITY, _LINE),
    "pose": (_POSE, _LINE),
}


Evaluate: TypeAlias = Callable[[State, bool], Residual]
"""All the arithmetic of a factor: its residual at a state, with the Jacobian if asked for."""

_Write: TypeAlias = Callable[[State, FloatArray, FloatArray | None], None]
# The same into a residual (rows,) and, unless None, a Jacobian (rows, columns) of Fortran order.


def evaluation(spec: RuledSurfaceSpec) -> Evaluate:
    """The arithmetic of the factor that `spec` describes, by the active kernel."""
    return _evaluation(spec, _writing(spec))


def _evaluation(spec: RuledSurfaceSpec, write: _Write) -> Evaluate:
    def evaluate(state: State, want_jacobian: bool) -> Residual:
        value = np.empty(spec.points.rows)
        jacobian = _jacobian(spec) if want_jacobian else None
        write(state, value, jacobian)
        return Residual(value, jacobian)

    return evaluate


def _jacobian(spec: RuledSurfaceSpec) -> FloatArray:
    """Room for one, without meaning."""
    columns = COLUMNS if spec.motion.time_jacobian is None else COLUMNS_WITH_TIME
    return np.empty((spec.points.rows, columns), order="F")


def _writing(spec: RuledSurfaceSpec) -> _Write:
    if active_kernel() == "native":
        surface = native_surface(spec)
        return lambda state, value, jacobian: surface.evaluate(*state, value, jacobian)
    geometry = Geometry(spec.chart, spec.motion, spec.body_T_cam)

    def write(state: State, value: FloatArray, jacobian: FloatArray | None) -> None:
        line = geometry.line_in_cameras(state, jacobian is not None)
        found = spec.points.residual(line)
        value[:] = found.value
        if jacobian is not None:
            jacobian[:] = found.jacobian

    return write


def native_surface(
    spec: RuledSurfaceSpec,
) -> "native.GeometricSurface | native.ReprojectionSurface":
    """The constants of the factor that `spec` describes, for the native kernel."""
    chart, motion, points = spec.chart, spec.motion, spec.points
    geometry = native.Geometry(
        chart.world_T_anchor.matrix(),
        chart.basis,
        chart.angle,
        spec.body_T_cam.matrix(),
        motion.elapsed,
        motion.preintegrated,
        motion.bias_jacobian,
        motion.bias,
        motion.time_jacobian,
    )
    if isinstance(points, CompressedPoints):
        return native.GeometricSurface(geometry, points.statistics)
    return native.ReprojectionSurface(geometry, points.points, points.sqrt_weights, points.frame)


class RuledSurfaceFactor(gtsam.CustomFactor):
    """The factor that a spec describes.

    As long as Python holds this object, it can be pickled, copied and cloned. What GTSAM hands
    back from a graph after Python has let go of it is a plain `CustomFactor` that still works but
    cannot; keep the `spec`.
    """

    def __init__(self, spec: RuledSurfaceSpec) -> None:
        write = _writing(spec)
        super().__init__(spec.noise_model, list(spec.keys), _ErrorFunction(spec, write))
        self.spec = spec
        """The plain data this factor was built from."""
        self.evaluate: Evaluate = _evaluation(spec, write)
        """The residual, and its Jacobian if asked for, at any state, without a graph."""
        if self.dim() != spec.points.rows:
            kind = "3 for each frame" if isinstance(spec.points, CompressedPoints) else "2 a point"
            raise FactorError(
                f"noise_model has dimension {self.dim()}, but this factor has "
                f"{spec.points.rows} rows ({kind})"
            )

    def clone(self) -> "RuledSurfaceFactor":
        """An equal factor, built anew."""
        return RuledSurfaceFactor(self.spec)

    def __reduce__(self) -> tuple[type, tuple[RuledSurfaceSpec]]:
        return RuledSurfaceFactor, (self.spec,)

    def __copy__(self) -> "RuledSurfaceFactor":
        return self.clone()


class _Room(NamedTuple):
    """For a Jacobian, and views of it: the columns of each key."""

    jacobian: FloatArray
    blocks: list[FloatArray]

    @classmethod
    def of(cls, spec: RuledSurfaceSpec) -> "_Room":
        jacobian = _jacobian(spec)
        return cls(jacobian, [jacobian[:, columns] for columns in _COLUMNS[spec.form]])


class _ErrorFunction:
    """The callback GTSAM keeps. It holds no reference to the factor: that would be a cycle through
    C++ which Python's collector cannot see.
    """

    def __init__(self, spec: RuledSurfaceSpec, write: _Write) -> None:
        self._form = spec.form
        self._gravity = spec.gravity
        self._magnitude = float(np.linalg.norm(spec.gravity))
        self._write = write
        self._rows = spec.points.rows
        self._spec = spec
        # GTSAM copies the blocks, so that they serve again; not while another thread has them.
        self._rooms: list[_Room] = []

    def __call__(
        self, this: gtsam.CustomFactor, values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        keys = this.keys()
        form = self._form
        velocity, bias, gravity = _NO_VELOCITY, _NO_BIAS, self._gravity
        by_direction, time_shift = None, 0.0
        if form != "pose":
            velocity = values.atVector(keys[1])
            bias = values.atConstantBias(keys[2]).vector()
            if form == "knot_gravity_direction":
                direction = values.atUnit3(keys[3])
                gravity = self._magnitude * direction.unitVector()
                by_direction = self._magnitude * direction.basis()
            elif form == "knot_gravity_vector":
                gravity = values.atVector(keys[3])
            elif form == "knot_time_offset":
                time_shift = values.atDouble(keys[3])
        pose, line = values.atPose3(keys[0]).matrix(), values.atVector(keys[-1])
        if velocity.size != 3 or gravity.size != 3 or line.size != 4:
            raise _wrong_size(keys, {1: velocity, 3: gravity, -1: line})
        state = State(pose, velocity, bias, gravity, line, time_shift)
        value = np.empty(self._rows)
        if H is None:
            self._write(state, value, None)
            return value
        try:
            room = self._rooms.pop()
        except IndexError:
            room = _Room.of(self._spec)
        self._write(state, value, room.jacobian)
        for i, block in enumerate(room.blocks):
            H[i] = block
        if by_direction is not None:
            H[3] = np.asfortranarray(room.blocks[3] @ by_direction)
        self._rooms.append(room)
        return value


def _wrong_size(keys: list[int], vectors: dict[int, FloatArray]) -> FactorError:
    """Of the first of the vectors, by the places of their keys."""
    for place, vector in vectors.items():
        size = 4 if place == -1 else 3
        if vector.size != size:
            name = gtsam.DefaultKeyFormatter(keys[place])
            return FactorError(f"{name} must hold a vector of {size}, not of {vector.size}")
    raise AssertionError("all have the right size")


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
    """One line over all frames that follow a knot, on the knot's state and the line.

    Residual (default points): r = C_j m_j / |m_j,xy| for every frame j, with m_j the line's moment
    in the camera at R_j = R Exp(theta_j(b)), p_j = p + v t_j + g t_j^2 / 2 + R dp_j(b).

    Args:
        noise_model: of dimension `points.rows`, any kind, robust ones too. Units: normalised image
            coordinates of one point, that is pixels over focal length. At the truth the whitened
            squared norm is the number of points; a robust constant belongs above its root.
        pose_key: Pose3, world_T_body of the knot.
        velocity_key: Vector3, of the body in the world, m/s.
        bias_key: imuBias.ConstantBias.
        line_key: Vector4, delta of `chart`.
        motion: of the frames in `points`, from `preintegrate_frames`.
        chart: of the line.
        points: the line's edge points: `CompressedPoints` for the geometric residual,
            `IndividualPoints` for the paper's.
        body_T_cam: camera pose in the body (IMU) frame, by default identity.
        gravity: in the world, m/s^2.

    Raises:
        FactorError: naming the argument that is wrong.

    Source: Zhu, Burner, Aloimonos, arXiv 2512.00327, Eq. 8 to 15, with the inertial motion
    expressed by a knot's state.
    """
    spec = RuledSurfaceSpec(
        form="knot",
        keys=(pose_key, velocity_key, bias_key, line_key),
        noise_model=noise_model,
        chart=chart,
        motion=motion,
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.asarray(gravity),
    )
    return RuledSurfaceFactor(spec)


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

    Takes `time_key` (double, s): how much later than `motion` says the frames were taken. The knot
    stays where it is; the frames' poses move along the motion, to first order (see the module
    `motion`, which needs `preintegrate_frames(..., with_time=True)`): good for some milliseconds.
    Where the estimate comes out larger, compute the times of coming frames with it. For all else
    see `ruled_surface_factor`.

    Source: the frame's own motion in place of Li and Mourikis, "Online temporal calibration for
    camera-IMU systems", IJRR 2014, who shift the camera's pose likewise.
    """
    spec = RuledSurfaceSpec(
        form="knot_time_offset",
        keys=(pose_key, velocity_key, bias_key, time_key, line_key),
        noise_model=noise_model,
        chart=chart,
        motion=motion,
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.asarray(gravity),
    )
    return RuledSurfaceFactor(spec)


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
    magnitude = positive_number("gravity_magnitude", gravity_magnitude)
    spec = RuledSurfaceSpec(
        form="knot_gravity_direction",
        keys=(pose_key, velocity_key, bias_key, gravity_key, line_key),
        noise_model=noise_model,
        chart=chart,
        motion=motion,
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.array([0.0, 0.0, -magnitude]),
    )
    return RuledSurfaceFactor(spec)


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
    spec = RuledSurfaceSpec(
        form="knot_gravity_vector",
        keys=(pose_key, velocity_key, bias_key, gravity_key, line_key),
        noise_model=noise_model,
        chart=chart,
        motion=motion,
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.array(STANDARD_GRAVITY),
    )
    return RuledSurfaceFactor(spec)


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
    spec = RuledSurfaceSpec(
        form="pose",
        keys=(pose_key, line_key),
        noise_model=noise_model,
        chart=chart,
        motion=FrameMotion.at_rest(),
        points=points,
        body_T_cam=gtsam.Pose3() if body_T_cam is None else body_T_cam,
        gravity=np.array(STANDARD_GRAVITY),
    )
    return RuledSurfaceFactor(spec)
