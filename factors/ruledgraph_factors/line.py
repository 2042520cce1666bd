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
from ruledgraph_factors.so3 import exp_and_right_jacobian, hat
from ruledgraph_factors.validation import FloatArray, finite_array, number, pose, rotation_matrix

# Below this, a unit Pluecker pair's direction (or moment) is rounding noise: the line is at
# infinity (or runs through the centre).
NEGLIGIBLE = 1e-12
# How far (rad) the foot of a ruling may lie off it: rounding and pixel noise, not another line.
_FOOT_ON_LINE = 0.05


@dataclass(frozen=True, eq=False)
class LineChart:
    """Chart around a reference line; a line is then a Vector4 `delta`, the reference zeros(4).

    Every method that maps `delta` (4,) to a quantity returns it with its derivative by `delta`:
    shape (..., 4). World quantities are in the frame of `world_T_anchor`, lengths in metres.

    A chart is not a retraction: GTSAM adds to `delta`. It is exact everywhere, but far from the
    reference (rotations near pi) steps grow crooked; give long-lived lines a new chart, see
    `reanchor`.
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
        m, v = _in_anchor(world_T_anchor, moment, direction)
        basis = _orthonormal_basis(m, v, np.eye(3))
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
        a, b, c = line = finite_array("image_line", image_line, (3,))
        if np.hypot(a, b) <= NEGLIGIBLE * float(np.linalg.norm(line)):
            raise FactorError("image_line: a and b are both zero, the line has no finite image")
        if number("inverse_distance", inverse_distance) < 0.0:
            raise FactorError(f"inverse_distance must not be negative, got {inverse_distance:g}")
        normal = line / np.linalg.norm(line)
        if foot is None:
            ray = np.array([-a * c, -b * c, a * a + b * b])
        else:
            ray = np.append(finite_array("foot", foot, (2,)), 1.0)
            if abs(normal @ ray) > _FOOT_ON_LINE * np.linalg.norm(ray):
                raise FactorError("foot: this image point does not lie on image_line")
            ray = ray - normal * (normal @ ray)
        u3 = -ray / np.linalg.norm(ray)
        basis = np.stack([normal, np.cross(u3, normal), u3], axis=1)
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
        rotation, position = _arrays(self.world_T_anchor)
        moment, direction = cosine * u[:, 0], sine * u[:, 1]
        d_u1, d_u2, _ = _column_derivatives(u, right_jacobian)
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
        m, v = _in_anchor(self.world_T_anchor, moment, direction)
        u = _orthonormal_basis(m, v, self.basis)
        angle = float(np.arctan2(np.linalg.norm(v), np.linalg.norm(m)))
        # (m, v) and (-m, -v) are one line, and so are (u2, phi) and (-u2, -phi).
        candidates = []
        for signs, side in (
            ((1, 1, 1), 1),
            ((-1, -1, 1), 1),
            ((1, -1, -1), -1),
            ((-1, 1, -1), -1),
        ):
            rotation = gtsam.Rot3(self.basis.T @ (u * np.array(signs)))
            turn = side * angle - self.angle
            turn -= np.pi * np.round(turn / np.pi)
            candidates.append(np.append(turn, gtsam.Rot3.Logmap(rotation)))
        return np.asarray(min(candidates, key=lambda d: float(d @ d)))

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
        cosine, sine = np.cos(phi), np.sin(phi)
        d_u1, d_u2, _ = _column_derivatives(u, right_jacobian)
        new_T_old = world_T_anchor.between(self.world_T_anchor)
        rotation, position = _arrays(new_T_old)

        direction = rotation @ u[:, 1]
        d_direction = np.column_stack([np.zeros(3), rotation @ d_u2])
        moment = rotation @ (cosine * u[:, 0]) + sine * np.cross(position, direction)
        d_moment = np.column_stack(
            [
                -sine * rotation @ u[:, 0] + cosine * np.cross(position, direction),
                cosine * rotation @ d_u1 + sine * hat(position) @ d_direction[:, 1:],
            ]
        )
        size = float(np.linalg.norm(moment))
        if size <= NEGLIGIBLE * (1.0 + float(np.linalg.norm(position))):
            raise FactorError("world_T_anchor: the line runs through the new anchor's centre")
        normal = moment / size
        basis = np.column_stack([normal, direction, np.cross(normal, direction)])
        d_size = normal @ d_moment
        d_normal = (d_moment - np.outer(normal, d_size)) / size
        # From U = U Exp(w): u3 . du2 = w0, -u3 . du1 = w1, u2 . du1 = w2; phi = atan2(sine, size).
        d_sine = np.array([cosine, 0.0, 0.0, 0.0])
        jacobian = np.stack(
            [
                (size * d_sine - sine * d_size) / (size**2 + sine**2),
                basis[:, 2] @ d_direction,
                -basis[:, 2] @ d_normal,
                basis[:, 1] @ d_normal,
            ]
        )
        # `basis` is orthonormal but for rounding; Rot3 puts that right before it is stored.
        basis = gtsam.Rot3.ClosestTo(basis).matrix()
        return LineChart(world_T_anchor, basis, float(np.arctan2(sine, size))), jacobian

    # -- quantities of the line ------------------------------------------------------------------

    def direction(self, delta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Unit direction in the world, (3,), and its derivative, (3, 4)."""
        u, _, right_jacobian = self.frame(_delta(delta))
        rotation, _ = _arrays(self.world_T_anchor)
        _, d_u2, _ = _column_derivatives(u, right_jacobian)
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
        rotation, position = _arrays(self.world_T_anchor)
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
        rotation, position = _arrays(self.world_T_anchor)
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
        _, d_u2, d_u3 = _column_derivatives(u, right_jacobian)
        distance = float(np.cos(phi)) / sine
        d_foot = np.column_stack([u[:, 2] / sine**2, -distance * d_u3])
        return -distance * u[:, 2], u[:, 1], d_foot, np.column_stack([np.zeros(3), d_u2])


def _delta(value: ArrayLike) -> FloatArray:
    return finite_array("delta", value, (4,))


def _arrays(frame: gtsam.Pose3) -> tuple[FloatArray, FloatArray]:
    return frame.rotation().matrix(), frame.translation()


def _column_derivatives(
    u: FloatArray, right_jacobian: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of u1, u2, u3 by delta[1:4], each (3, 3): d u_i = U (w x e_i), w = Jr d delta."""
    w0, w1, w2 = right_jacobian
    u1, u2, u3 = u.T
    return (
        np.outer(u2, w2) - np.outer(u3, w1),
        np.outer(u3, w0) - np.outer(u1, w2),
        np.outer(u1, w1) - np.outer(u2, w0),
    )


def _in_anchor(
    world_T_anchor: gtsam.Pose3, moment: ArrayLike, direction: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """World Pluecker pair in the anchor frame, moment made perpendicular, scaled to unit norm."""
    rotation, position = _arrays(world_T_anchor)
    m = finite_array("moment", moment, (3,))
    v = finite_array("direction", direction, (3,))
    largest = max(float(np.abs(m).max()), float(np.abs(v).max()))
    if largest == 0.0:
        raise FactorError("direction: moment and direction are both zero, that is no line")
    m, v = m / largest, v / largest
    m, v = rotation.T @ (m - np.cross(position, v)), rotation.T @ v
    size = float(np.sqrt(m @ m + v @ v))
    m, v = m / size, v / size
    if np.linalg.norm(v) > NEGLIGIBLE:
        m = m - v * (v @ m) / (v @ v)
    return m, v


def _orthonormal_basis(m: FloatArray, v: FloatArray, preferred: FloatArray) -> FloatArray:
    """(u1 u2 u3) with u1 along m and u2 along v; what a zero m or v leaves open comes as close to
    the columns of `preferred` as it can.
    """
    if np.linalg.norm(v) > NEGLIGIBLE:
        u2 = v / np.linalg.norm(v)
        u1 = _unit_perpendicular(u2, m, preferred)
    else:
        u1 = m / np.linalg.norm(m)
        u2 = _unit_perpendicular(u1, v, np.roll(preferred, -1, axis=1))
    return np.column_stack([u1, u2, np.cross(u1, u2)])


def _unit_perpendicular(axis: FloatArray, wish: FloatArray, fallbacks: FloatArray) -> FloatArray:
    """Unit vector perpendicular to the unit `axis`, along `wish` or the first fallback that is not
    parallel to the axis.
    """
    for candidate, least in ((wish, NEGLIGIBLE), *((column, 0.5) for column in fallbacks.T)):
        rest = candidate - axis * (axis @ candidate)
        if np.linalg.norm(rest) > least:
            # A second pass takes out what rounding left along the axis.
            rest = rest / np.linalg.norm(rest)
            rest = rest - axis * (axis @ rest)
            return np.asarray(rest / np.linalg.norm(rest))
    raise AssertionError("two orthogonal fallbacks cannot both be parallel to the axis")
