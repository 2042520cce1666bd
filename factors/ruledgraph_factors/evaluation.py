# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The arithmetic of the factor that a spec describes, by the active kernel.

The columns of a Jacobian are those of the module `ruled_surface`, but for the camera's pose in the
body and its focal ratio: where they are variables they come last, in this order.
"""

from collections.abc import Callable
from typing import TypeAlias

import gtsam
import numpy as np

from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.ruled_surface import (
    COLUMNS,
    COLUMNS_WITH_TIME,
    EXTRINSICS_COLUMNS,
    FOCAL_COLUMNS,
    Geometry,
    Residual,
    State,
)
from ruledgraph_factors.so3 import exp_and_right_jacobian, hat
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray

Evaluate: TypeAlias = Callable[[State, bool], Residual]
"""All the arithmetic of a factor: its residual at a state, with the Jacobian if asked for."""

Write: TypeAlias = Callable[[State, FloatArray, FloatArray | None], None]
"""The same into a residual (rows,) and, unless None, a Jacobian (rows, columns), Fortran order."""


def evaluation(spec: RuledSurfaceSpec, write: Write | None = None) -> Evaluate:
    """The residual and Jacobian of the factor, by `write` if that is at hand."""
    write = writing(spec) if write is None else write

    def evaluate(state: State, want_jacobian: bool) -> Residual:
        value = np.empty(spec.points.rows)
        jacobian = jacobian_buffer(spec) if want_jacobian else None
        write(state, value, jacobian)
        return Residual(value, jacobian)

    return evaluate


def jacobian_buffer(spec: RuledSurfaceSpec) -> FloatArray:
    """An uninitialised array for a Jacobian."""
    columns = _state_columns(spec)
    columns += EXTRINSICS_COLUMNS if spec.has_extrinsics else 0
    columns += FOCAL_COLUMNS if spec.has_focal_ratio else 0
    return np.empty((spec.points.rows, columns), order="F")


def _state_columns(spec: RuledSurfaceSpec) -> int:
    """Without extrinsics and focal ratio."""
    return COLUMNS if spec.motion.time_jacobian is None else COLUMNS_WITH_TIME


def writing(spec: RuledSurfaceSpec) -> Write:
    """The arithmetic, into arrays of the caller's."""
    if active_kernel() == "native":
        surface = native_surface(spec)

        def write_natively(state: State, value: FloatArray, jacobian: FloatArray | None) -> None:
            surface.evaluate(*_own(spec, state), value, jacobian)

        return write_natively
    first = _state_columns(spec)
    last = first + (EXTRINSICS_COLUMNS if spec.has_extrinsics else 0)

    def write(state: State, value: FloatArray, jacobian: FloatArray | None) -> None:
        own = _own(spec, state)
        camera = spec.body_T_cam if own.body_T_cam is None else gtsam.Pose3(own.body_T_cam)
        geometry = Geometry(spec.chart, spec.motion, camera)
        line = geometry.line_in_cameras(own, jacobian is not None)
        found = spec.points.residual(line, own.focal_ratio)
        value[:] = found.value
        if jacobian is None or found.jacobian is None:
            return
        jacobian[:, :first] = found.jacobian[:, :first]
        if spec.has_extrinsics:
            jacobian[:, first:last] = _by_extrinsics(spec, own, camera, found.jacobian[:, :6])
        jacobian[:, last:] = found.jacobian[:, first:]

    return write


def _own(spec: RuledSurfaceSpec, state: State) -> State:
    """Without what is no variable of the factor.

    Raises:
        FactorError: for frames that are shifted in time, but do not know how they would move.
    """
    spec.motion.require_time(state.time_shift)
    if spec.has_extrinsics and spec.has_focal_ratio:
        return state
    return state._replace(
        body_T_cam=state.body_T_cam if spec.has_extrinsics else None,
        focal_ratio=state.focal_ratio if spec.has_focal_ratio else None,
    )


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
    if isinstance(points, GeometricPoints):
        return native.GeometricSurface(geometry, points.statistics)
    return native.ReprojectionSurface(geometry, points.points, points.sqrt_weights, points.frame)


def _by_extrinsics(
    spec: RuledSurfaceSpec, state: State, body_T_cam: gtsam.Pose3, by_pose: FloatArray
) -> FloatArray:
    """Jacobian (rows, 6) by body_T_cam, from that by the pose (rows, 6).

    With D_j = (Exp(theta_j), dp_j) the preintegrated motion, E Exp(w) moves the camera of frame j
    as X Exp(Ad(D_j E) w) does: a frame's rows are those of the pose times Ad(D_j E).
    """
    motion = spec.motion.corrected(state.bias, state.time_shift)
    start_R_frame, _ = exp_and_right_jacobian(motion[:, :3])
    turn = start_R_frame @ body_T_cam.rotation().matrix()
    shift = motion[:, 3:6] + start_R_frame @ body_T_cam.translation()
    adjoint = np.zeros((len(turn), 6, 6))
    adjoint[:, :3, :3] = adjoint[:, 3:, 3:] = turn
    adjoint[:, 3:, :3] = hat(shift) @ turn
    points = spec.points
    if isinstance(points, GeometricPoints):
        blocks = by_pose.reshape(len(turn), 3, 6) @ adjoint
    else:
        blocks = by_pose.reshape(len(points.frame), 2, 6) @ adjoint[points.frame]
    return np.asarray(blocks.reshape(-1, 6))
