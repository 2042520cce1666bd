# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The 4-DoF line variable: an anchored orthonormal (inverse-depth) chart on R^4.

A line is the Pluecker pair (m, v): direction v and moment m = x x v of any point x on it. In an
*anchor* frame A, usually the camera pose in which the line was first seen, a constant,

    m_A = cos(phi) u1,   v_A = sin(phi) u2,
    (u1 u2 u3) = U0 Exp(delta[1:4]),   phi = phi0 + delta[0].

u1 is the normal of the plane through the anchor's centre and the line, u2 the line's direction,
-cot(phi) u3 its point closest to the anchor's centre, tan(phi) its inverse distance. From one image
delta[2] and delta[3] (the plane) are seen; delta[0] (the distance) and delta[1] (the direction
inside the plane) are not, and both stay near-Gaussian. The order matters to GTSAM: its Cholesky
factorisation calls a variable indeterminate whose last pivot is some 4096 times smaller than the
one before, so the two that are always well seen come last.

Source: orthonormal representation of Bartoli and Sturm, "Structure-from-motion using lines", CVIU
2005; the anchoring makes its second factor an inverse distance.

Defined behaviour at the ends of the chart:

- *Line at infinity*, sin(phi) = 0: `plucker`, `direction`, `inverse_distance`, `reanchor` and all
  factors work; `closest_point`, `distance_to` and `end_points` raise `FactorError`. delta[1] has no
  effect there, so a Hessian from factors alone loses that one rank.
- *Line through the anchor's centre*, cos(phi) = 0: everything works; delta[2] has no effect.
  `reanchor` refuses an anchor whose centre lies on the line.
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.plucker import (
    NEGLIGIBLE,
    column_derivatives,
    nearest_coordinates,
    orthonormal_basis,
    pose_arrays,
    ruling_frame,
    seen_from,
    unit_pair,
)
from ruledgraph_factors.so3 import exp_and_right_jacobian, hat
from ruledgraph_factors.validation import FloatArray, finite_array, number, pose, rotation_matrix


@dataclass(frozen=True, eq=False)
class LineChart:
    """Chart around a reference line; a line is then a Vector4 `delta`, the reference zeros(4).

    Every method that maps `delta` (4,) to a quantity returns it with its derivative by `delta`:
    shape (..., 4). World quantities are in the frame of `world_T_anchor`, lengths in metres.

    A chart is not a retraction: GTSAM adds to `delta`. It is exact everywhere, but far from the
    reference (rotations near pi) steps are strongly nonlinear; give long-lived lines a new chart,
    see `reanchor`.
    """

    world_T_anchor: gtsam.Pose3
    """Anchor frame, a constant."""
    basis: FloatArray
    """U0, (3, 3), a rotation; columns u1, u2, u3 of the reference line in the anchor frame."""
    angle: float
    """phi0, rad; its tangent is the reference line's inverse distance, 1/m."""

    def __post_init__(self) -> None:
        pose("world_T_anchor", self.world_T_anchor)
        object.__setattr__(self, "basis", rotation_matrix("basis", self.basis))
        object.__setattr__(self, "angle", number("angle", self.angle))

    # -- building a chart ------------------------------------------------------------------------

    @classmethod
    def from_plucker(
        cls, world_T_anchor: gtsam.Pose3, moment: ArrayLike, direction: ArrayLike
    ) -> "LineChart":
        """Chart around the world line (moment, direction), of any common scale.

        The part of `moment` along `direction` is dropped. direction = 0 is a line at infinity,
        moment = 0 (about the anchor) a line through the anchor's centre.

        Raises:
            FactorError: when both are zero.
        """
        pose("world_T_anchor", world_T_anchor)
        m, v = unit_pair(world_T_anchor, moment, direction)
        basis = orthonormal_basis(m, v, np.eye(3))
        return cls(world_T_anchor, basis, float(np.arctan2(np.linalg.norm(v), np.linalg.norm(m))))

    @classmethod
    def from_points(
        cls, world_T_anchor: gtsam.Pose3, first: ArrayLike, second: ArrayLike
    ) -> "LineChart":
        """Chart around the line through two distinct world points (3,), from first to second."""
        a = finite_array("first", first, (3,))
        b = finite_array("second", second, (3,))
        length = float(np.linalg.norm(b - a))
        if length <= NEGLIGIBLE * (1.0 + float(np.linalg.norm(a))):
            raise FactorError("second: the two points coincide, no line runs through them alone")
        direction = (b - a) / length
        return cls.from_plucker(world_T_anchor, np.cross(a, direction), direction)

    @classmethod
    def from_ruling(
        cls,
        world_T_cam: gtsam.Pose3,
        image_line: ArrayLike,
        inverse_distance: float,
        foot: ArrayLike | None = None,
    ) -> "LineChart":
        """Chart around the line whose image is a x + b y + c = 0, anchored in that camera.

        One image does not show the direction inside the viewing plane; the reference line is taken
        perpendicular to the ray through `foot`, so that `foot` is its closest point.

        Args:
            world_T_cam: camera pose (optical axes), the anchor.
            image_line: (a, b, c) in normalised image coordinates.
            inverse_distance: one over the distance from camera centre to line, >= 0, 1/m.
            foot: image point (x, y) on the line where it is closest to the camera; by default the
                one next to the principal point. The middle of the seen segment is a good choice.

        Raises:
            FactorError: for a = b = 0 (a line without a finite image), a negative distance.
        """
        basis = ruling_frame(image_line, foot)
        if number("inverse_distance", inverse_distance) < 0.0:
            raise FactorError(f"inverse_distance must not be negative, got {inverse_distance:g}")
        return cls(world_T_cam, basis, float(np.arctan(inverse_distance)))

    # -- the chart -------------------------------------------------------------------------------

    def frame(self, delta: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """U (3, 3), phi and the right Jacobian Jr(delta[1:4]) (3, 3) at `delta`."""
        rotation, right_jacobian = exp_and_right_jacobian(delta[1:])
        return self.basis @ rotation, self.angle + float(delta[0]), right_jacobian

    def plucker(self, delta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """World Pluecker coordinates (moment, direction), (6,), and their derivative, (6, 4).

        Scaled so that |m_A|^2 + |v_A|^2 = 1 in the anchor frame, which keeps infinity regular.
        """
        if active_kernel() == "native":
            anchor = self.world_T_anchor.matrix()
            return native.plucker(anchor, self.basis, self.angle, _delta(delta))
        u, phi, right_jacobian = self.frame(_delta(delta))
        cosine, sine = np.cos(phi), np.sin(phi)
        rotation, position = pose_arrays(self.world_T_anchor)
        moment, direction = cosine * u[:, 0], sine * u[:, 1]
        d_u1, d_u2, _ = column_derivatives(u, right_jacobian)
        d_moment = np.column_stack([-sine * u[:, 0], cosine * d_u1])
        d_direction = np.column_stack([cosine * u[:, 1], sine * d_u2])
        across = hat(position) @ rotation
        return (
            np.concatenate([rotation @ moment + across @ direction, rotation @ direction]),
            np.concatenate([rotation @ d_moment + across @ d_direction, rotation @ d_direction]),
        )

    def local(self, moment: ArrayLike, direction: ArrayLike) -> FloatArray:
        """`delta` (4,) of the world line (moment, direction): the inverse of `plucker`.

        A line has four equivalent frames U (its and its normal's sign are free); the one nearest
        to the reference is taken.
        """
        m, v = unit_pair(self.world_T_anchor, moment, direction)
        u = orthonormal_basis(m, v, self.basis)
        angle = float(np.arctan2(np.linalg.norm(v), np.linalg.norm(m)))
        return nearest_coordinates(self.basis, u, self.angle, angle)

    def wrapped(self, delta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The smallest `delta` (4,) of the same line, and its derivative by `delta`, (4, 4).

        phi counts modulo pi and a line has four frames U: of a line that is not far (`is_far`)
        it is `delta` itself.
        """
        here = _delta(delta)
        u, phi, right_jacobian = self.frame(here)
        smallest = nearest_coordinates(self.basis, u, self.angle, phi)
        there, _, there_jacobian = self.frame(smallest)
        # U' = U S with signs S; U Exp(w) S = U S Exp(S w), and phi' = s_1 s_2 phi.
        signs = np.sign(np.sum(u * there, axis=0))
        jacobian = np.zeros((4, 4))
        jacobian[0, 0] = signs[0] * signs[1]
        jacobian[1:, 1:] = np.linalg.solve(there_jacobian, signs[:, None] * right_jacobian)
        return smallest, jacobian

    @staticmethod
    def is_far(delta: ArrayLike) -> bool:
        """Whether |delta| >= pi/2: within that every line has one `delta`, its smallest, in any
        chart; from there on it may have wrapped. Time for `recentred`. Not of NaN.
        """
        here = np.asarray(delta, dtype=np.float64)
        if here.shape != (4,):
            here = _delta(delta)  # raises
        return float(np.linalg.norm(here)) >= 0.5 * np.pi

    def recentred(self, delta: ArrayLike) -> tuple["LineChart", FloatArray]:
        """The same line in a chart around it, at the same anchor (there at zeros(4), |phi0| at most
        pi/2), and d delta_new / d delta = diag(1, Jr(delta[1:4])), (4, 4).
        """
        u, phi, right_jacobian = self.frame(_delta(delta))
        jacobian = np.eye(4)
        jacobian[1:, 1:] = right_jacobian
        basis = gtsam.Rot3.ClosestTo(u).matrix()
        return LineChart(
            self.world_T_anchor, basis, phi - np.pi * float(np.round(phi / np.pi))
        ), jacobian

    def reanchor(
        self, delta: ArrayLike, world_T_anchor: gtsam.Pose3
    ) -> tuple["LineChart", FloatArray]:
        """The same line in a new chart (there at zeros(4)), and d delta_new / d delta, (4, 4).

        With that derivative J a covariance travels as J S J^T.

        Raises:
            FactorError: when the line runs through the new anchor's centre.
        """
        pose("world_T_anchor", world_T_anchor)
        u, phi, right_jacobian = self.frame(_delta(delta))
        new_T_old = world_T_anchor.between(self.world_T_anchor)
        basis, angle, jacobian = seen_from(new_T_old, u, phi, right_jacobian)
        return LineChart(world_T_anchor, basis, angle), jacobian

    # -- quantities of the line ------------------------------------------------------------------

    def direction(self, delta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Unit direction in the world, (3,), and its derivative, (3, 4)."""
        u, _, right_jacobian = self.frame(_delta(delta))
        rotation, _ = pose_arrays(self.world_T_anchor)
        _, d_u2, _ = column_derivatives(u, right_jacobian)
        return rotation @ u[:, 1], np.column_stack([np.zeros(3), rotation @ d_u2])

    def inverse_distance(self, delta: ArrayLike) -> tuple[float, FloatArray]:
        """tan(phi), one over the distance to the anchor's centre (1/m), and its derivative, (4,).

        It changes sign where the line passes through infinity to the anchor's other side, and
        again where it passes through the anchor's centre.
        """
        tangent = float(np.tan(self.angle + _delta(delta)[0]))
        return tangent, np.array([1.0 + tangent**2, 0.0, 0.0, 0.0])

    def closest_point(
        self, delta: ArrayLike, to: ArrayLike | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """World point of the line closest to `to`, by default to the anchor's centre, (3,).

        Raises:
            FactorError: for a line at infinity.
        """
        rotation, position = pose_arrays(self.world_T_anchor)
        foot, along, d_foot, d_along = self._foot_and_direction(_delta(delta))
        if to is not None:
            target = rotation.T @ (finite_array("to", to, (3,)) - position)
            reach = float(along @ target)
            foot = foot + reach * along
            d_foot = d_foot + reach * d_along + np.outer(along, target @ d_along)
        return rotation @ foot + position, rotation @ d_foot

    def distance_to(
        self, delta: ArrayLike, point: ArrayLike
    ) -> tuple[float, FloatArray, FloatArray]:
        """Distance from the line to a world point (m), its derivatives by `delta`, (4,), and by
        the point, (3,). On the line itself, to rounding, where the distance has a kink, both
        derivatives are zero.

        Raises:
            FactorError: for a line at infinity.
        """
        point = finite_array("point", point, (3,))
        closest, d_closest = self.closest_point(delta, point)
        offset = point - closest
        distance = float(np.linalg.norm(offset))
        rounding = NEGLIGIBLE * (1.0 + float(np.linalg.norm(point)))
        unit = offset / distance if distance > rounding else np.zeros(3)
        # `closest` moves along the line with `point`, and `unit` is perpendicular to the line.
        return distance, -unit @ d_closest, unit

    def end_points(self, delta: ArrayLike, extent: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """World end points, (2, 3), of the stretch `extent` of the line, and (2, 3, 4).

        Args:
            delta: the line, (4,).
            extent: two signed lengths along `direction`, counted from the point closest to the
                anchor's centre, (2,), m.

        Raises:
            FactorError: for a line at infinity.
        """
        rotation, position = pose_arrays(self.world_T_anchor)
        foot, along, d_foot, d_along = self._foot_and_direction(_delta(delta))
        reach = finite_array("extent", extent, (2,))[:, None]
        ends = (foot + reach * along) @ rotation.T + position
        return ends, rotation @ (d_foot + reach[..., None] * d_along)

    def _foot_and_direction(
        self, delta: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Point closest to the anchor's centre and unit direction, anchor frame, with (3, 4)s."""
        u, phi, right_jacobian = self.frame(delta)
        sine = float(np.sin(phi))
        if abs(sine) <= NEGLIGIBLE:
            raise FactorError("delta: the line is at infinity and has no finite point")
        _, d_u2, d_u3 = column_derivatives(u, right_jacobian)
        distance = float(np.cos(phi)) / sine
        d_foot = np.column_stack([u[:, 2] / sine**2, -distance * d_u3])
        return -distance * u[:, 2], u[:, 1], d_foot, np.column_stack([np.zeros(3), d_u2])


def _delta(value: ArrayLike) -> FloatArray:
    return finite_array("delta", value, (4,))
