# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Ruled surfaces of a window and their least squares (eq. 8 to 15), in the derotated frame."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ruledgraph.core.arrays import FloatArray

# Nearer than this a point counts as behind the camera, m, with this residual.
_NEAREST = 0.02
_BEHIND = 1.0
# Of d1, d2 (rad), x, y (m), velocity (m/s), gravity (m/s^2): how far one solution may lie from the
# one before where the points say nothing, counted as a single point with this residual.
_LINE_STEPS = (0.05, 0.05, 0.05, 0.05)
_MOTION_STEPS = (0.05, 0.05, 0.05, 0.1, 0.1, 0.1)
_STEP_RESIDUAL = 0.003
_TOLERANCE = 1e-6
_MAX_EVALUATIONS = 30


class Points(NamedTuple):
    """Points of a window, in the order of their lines."""

    p: FloatArray
    """Derotated, normalised, (N, 2)."""
    line: NDArray[np.int64]
    """Which line's, (N,), ascending."""
    time: FloatArray
    """Since the window's first frame, (N,), s."""
    gamma: FloatArray
    """Double integral of the accelerometer at that time, (N, 3), m."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """RS(t0, tn) of eq. 16. Point i of line l at t is X0_l + alpha V0_l + X(t)."""

    X0: FloatArray
    """Perpendicular to V0, (M, 3), m."""
    V0: FloatArray
    """Unit, (M, 3)."""
    velocity: FloatArray
    """Of the scene in the camera frame at t0, with the linear bias, (3,), m/s."""
    gravity: FloatArray
    """With the bias of the accelerometer, (3,), m/s^2; of a body at rest it points up."""

    def displacement(self, time: FloatArray, gamma: FloatArray) -> FloatArray:
        """X(t) of eq. 8, (N, 3): times (N,), s, since t0, gamma (N, 3)."""
        t = np.asarray(time)[:, None]
        return np.asarray(t * self.velocity - gamma + 0.5 * t * t * self.gravity)

    def distances(self, p: FloatArray, displacement: FloatArray) -> FloatArray:
        """Of points (N, 2) from each line's ruling after a displacement (3,), normalised, (M, N).

        The ruling goes through the projections of alpha = 0 and 1; its normal is S x V. Infinite
        where the ruling's nearest point is behind the camera.
        """
        S = self.X0 + displacement
        normal = np.cross(S, self.V0)
        size = np.maximum(np.hypot(normal[:, 0], normal[:, 1]), 1e-12)
        off = np.abs(normal[:, :2] @ p.T + normal[:, 2:]) / size[:, None]
        return np.where(S[:, 2:] > _NEAREST, off, np.inf)

    def alpha(self, points: "Points") -> FloatArray:
        """Place of each point along its line, eq. 15, (N,), m."""
        return _alpha(self, points).alpha[:, 0]

    def perturbed(self, rng: np.random.Generator, sigma: float) -> "Surfaces":
        """Small random changes that keep the constraints."""
        chart = _Chart(self)
        return chart.surfaces(chart.origin + rng.normal(0.0, sigma, chart.origin.size))


class _Chart:
    """4 M + 6 numbers around surfaces: per line (d1, d2, x, y), then velocity and gravity.

    V0 = (v + d1 b1 + d2 b2) / n with n its norm, b1, b2, v orthonormal;
    X0 = x b1 + y b2 - (x d1 + y d2) v, perpendicular to V0.
    """

    def __init__(self, surfaces: Surfaces) -> None:
        self._v = surfaces.V0
        # Two unit vectors perpendicular to V0, from the axis it is least along.
        axes = np.eye(3)[np.argmin(np.abs(self._v), axis=1)]
        b1 = np.cross(self._v, axes)
        self._b1 = b1 / np.linalg.norm(b1, axis=1, keepdims=True)
        self._b2 = np.cross(self._v, self._b1)
        self.lines = len(self._v)
        own = np.zeros((self.lines, 4))
        own[:, 2] = np.sum(surfaces.X0 * self._b1, axis=1)
        own[:, 3] = np.sum(surfaces.X0 * self._b2, axis=1)
        self.origin = np.concatenate([own.ravel(), surfaces.velocity, surfaces.gravity])

    def surfaces(self, unknowns: FloatArray) -> Surfaces:
        d1, d2, x, y = unknowns[:-6].reshape(-1, 4).T[:, :, None]
        V0 = self._v + d1 * self._b1 + d2 * self._b2
        V0 = V0 / np.linalg.norm(V0, axis=1, keepdims=True)
        X0 = x * self._b1 + y * self._b2 - (x * d1 + y * d2) * self._v
        return Surfaces(X0, V0, unknowns[-6:-3], unknowns[-3:])

    def jacobians(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """dX0 and dV0 by each line's four numbers, (M, 3, 4)."""
        d1, d2, x, y = unknowns[:-6].reshape(-1, 4).T[:, :, None]
        raw = self._v + d1 * self._b1 + d2 * self._b2
        n = np.linalg.norm(raw, axis=1, keepdims=True)
        V0 = raw / n
        by_d = [(b - V0 * np.sum(V0 * b, axis=1, keepdims=True)) / n for b in (self._b1, self._b2)]
        zero = np.zeros_like(V0)
        dV = np.stack([*by_d, zero, zero], axis=2)
        dX = np.stack(
            [-x * self._v, -y * self._v, self._b1 - d1 * self._v, self._b2 - d2 * self._v], axis=2
        )
        return dX, dV


class _Evaluation(NamedTuple):
    residuals: FloatArray
    """(N,)."""
    by_S: FloatArray
    """Derivative by S = X0 + X(t), (N, 3)."""
    by_V: FloatArray
    """Derivative by V0, (N, 3)."""


class _Alpha(NamedTuple):
    """alpha = (P . Phi) / (P . P), P = p V_z - V_xy, Phi = S_xy - p S_z, S = X0 + X(t)."""

    alpha: FloatArray
    S: FloatArray
    V: FloatArray
    P: FloatArray
    Phi: FloatArray
    PP: FloatArray


def _alpha(surfaces: Surfaces, points: Points) -> _Alpha:
    p = points.p
    S = surfaces.X0[points.line] + surfaces.displacement(points.time, points.gamma)
    V = surfaces.V0[points.line]
    P = p * V[:, 2:] - V[:, :2]
    Phi = S[:, :2] - p * S[:, 2:]
    PP = np.maximum(np.sum(P * P, axis=1, keepdims=True), 1e-12)
    return _Alpha(np.sum(P * Phi, axis=1, keepdims=True) / PP, S, V, P, Phi, PP)


def _evaluate(surfaces: Surfaces, points: Points, with_jacobian: bool) -> _Evaluation:
    """R = p - Q_xy / Q_z, Q = S + alpha V, which is (alpha P - Phi) / Q_z.

    alpha makes it perpendicular to P, so one number is all of it:
    e = -c / (|P| Q_z), c = P_x Phi_y - P_y Phi_x, with e^2 = |r|^2 in eq. 12.
    """
    p = points.p
    alpha, S, V, P, Phi, PP = _alpha(surfaces, points)
    Qz = S[:, 2:] + alpha * V[:, 2:]
    front = Qz > _NEAREST
    depth = np.where(front, Qz, 1.0)
    c = P[:, :1] * Phi[:, 1:] - P[:, 1:] * Phi[:, :1]
    size = np.sqrt(PP)
    e = -c / (size * depth)
    residuals = np.where(front, e, _BEHIND)[:, 0]
    if not with_jacobian:
        return _Evaluation(residuals, np.empty(0), np.empty(0))

    def through(a: FloatArray) -> FloatArray:
        """A [-I, p] of rows a (N, 2): dP = [-I, p] dV, dPhi = -[-I, p] dS."""
        return np.concatenate([-a, np.sum(a * p, axis=1, keepdims=True)], axis=1)

    P_through = through(P)
    depth_by_S = -V[:, 2:] / PP * P_through
    depth_by_S[:, 2] += 1.0
    depth_by_V = V[:, 2:] / PP * through(Phi - 2.0 * alpha * P)
    depth_by_V[:, 2:] += alpha
    c_by_S = through(P[:, ::-1] * [1.0, -1.0])
    c_by_V = through(Phi[:, ::-1] * [1.0, -1.0])
    scale = np.where(front, -1.0 / (size * depth), 0.0)
    share = np.where(front, e / depth, 0.0)
    by_S = scale * c_by_S - share * depth_by_S
    by_V = scale * c_by_V - share * depth_by_V - np.where(front, e / PP, 0.0) * P_through
    return _Evaluation(residuals, by_S, by_V)


def loss(surfaces: Surfaces, points: Points, frames: int) -> float:
    """Eq. 12, the sum of squares over the points of one time, as the mean over the frames."""
    return float(np.sum(_evaluate(surfaces, points, with_jacobian=False).residuals ** 2)) / frames


def solve(start: Surfaces, points: Points) -> Surfaces:
    """Eq. 15 from a start, by Levenberg-Marquardt; what the points leave open stays as it is."""
    chart = _Chart(start)
    columns = 4 * chart.lines
    ends = np.searchsorted(points.line, np.arange(chart.lines + 1))
    t = points.time[:, None]

    hold = _STEP_RESIDUAL / np.array(_LINE_STEPS * chart.lines + _MOTION_STEPS)

    def residuals(unknowns: FloatArray) -> FloatArray:
        found = _evaluate(chart.surfaces(unknowns), points, with_jacobian=False)
        return np.concatenate([found.residuals, hold * (unknowns - chart.origin)])

    def jacobian(unknowns: FloatArray) -> FloatArray:
        _, by_S, by_V = _evaluate(chart.surfaces(unknowns), points, with_jacobian=True)
        dX, dV = chart.jacobians(unknowns)
        J = np.zeros((len(points.p) + columns + 6, columns + 6))
        for line in range(chart.lines):
            own = slice(ends[line], ends[line + 1])
            J[own, 4 * line : 4 * line + 4] = by_S[own] @ dX[line] + by_V[own] @ dV[line]
        J[: len(t), columns : columns + 3] = t * by_S
        J[: len(t), columns + 3 :] = (0.5 * t * t) * by_S
        J[len(t) :] = np.diag(hold)
        return J

    found = least_squares(
        residuals,
        chart.origin,
        jacobian,
        method="lm",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        x_scale="jac",
        max_nfev=_MAX_EVALUATIONS,
    )
    return chart.surfaces(found.x)
