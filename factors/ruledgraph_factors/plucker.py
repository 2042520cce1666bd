# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Arithmetic of Pluecker pairs and of the frames U = (u1 u2 u3) that `LineChart` keeps of them.

u1 is the unit moment, u2 the unit direction, u3 = u1 x u2.
"""

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.validation import FloatArray, finite_array

# Below this, a unit Pluecker pair's direction (or moment) is rounding noise: the line is at
# infinity (or runs through the centre).
NEGLIGIBLE = 1e-12
# How far (rad) the foot of a ruling may lie off it: rounding and pixel noise, not another line.
_FOOT_ON_LINE = 0.05


def pose_arrays(frame: gtsam.Pose3) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,)."""
    return frame.rotation().matrix(), frame.translation()


def ruling_frame(image_line: ArrayLike, foot: ArrayLike | None) -> FloatArray:
    """U, (3, 3), of a line with this image, perpendicular to the ray through its foot.

    Args:
        image_line: (a, b, c) of a x + b y + c = 0, normalised image coordinates.
        foot: image point on it, (2,), by default the one next to the principal point.

    Raises:
        FactorError: for a = b = 0, or a foot that is not on the line.
    """
    a, b, c = line = finite_array("image_line", image_line, (3,))
    if np.hypot(a, b) <= NEGLIGIBLE * float(np.linalg.norm(line)):
        raise FactorError("image_line: a and b are both zero, the line has no finite image")
    normal = line / np.linalg.norm(line)
    if foot is None:
        ray = np.array([-a * c, -b * c, a * a + b * b])
    else:
        ray = np.append(finite_array("foot", foot, (2,)), 1.0)
        if abs(normal @ ray) > _FOOT_ON_LINE * np.linalg.norm(ray):
            raise FactorError("foot: this image point does not lie on image_line")
        ray = ray - normal * (normal @ ray)
    u3 = -ray / np.linalg.norm(ray)
    return np.stack([normal, np.cross(u3, normal), u3], axis=1)


def seen_from(
    new_T_old: gtsam.Pose3, u: FloatArray, phi: float, right_jacobian: FloatArray
) -> tuple[FloatArray, float, FloatArray]:
    """U and phi of a line in another frame, and d delta_new / d delta_old, (4, 4).

    Args:
        new_T_old: pose of the old frame in the new one.
        u: U in the old frame, (3, 3).
        phi: angle there.
        right_jacobian: Jr(delta[1:4]) in the old frame, (3, 3).

    Raises:
        FactorError: when the line runs through the new frame's origin.
    """
    cosine, sine = float(np.cos(phi)), float(np.sin(phi))
    d_u1, d_u2, _ = column_derivatives(u, right_jacobian)
    rotation, position = pose_arrays(new_T_old)
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
    return gtsam.Rot3.ClosestTo(basis).matrix(), float(np.arctan2(sine, size)), jacobian


def nearest_coordinates(
    reference: FloatArray, u: FloatArray, turn: float, angle: float
) -> FloatArray:
    """Delta (4,) of the line (u, angle) about a `reference` frame at `turn`: the smallest.

    (m, v) and (-m, -v) are one line, and so are (u2, phi) and (-u2, -phi): a line has four frames
    U, and phi counts modulo pi.
    """
    candidates = []
    for signs, side in (((1, 1, 1), 1), ((-1, -1, 1), 1), ((1, -1, -1), -1), ((-1, 1, -1), -1)):
        rotation = gtsam.Rot3(reference.T @ (u * np.array(signs)))
        nearer = side * angle - turn
        nearer -= np.pi * np.round(nearer / np.pi)
        candidates.append(np.append(nearer, gtsam.Rot3.Logmap(rotation)))
    return np.asarray(min(candidates, key=lambda d: float(d @ d)))


def column_derivatives(
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


def unit_pair(
    world_T_anchor: gtsam.Pose3, moment: ArrayLike, direction: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """World Pluecker pair in the anchor frame, moment made perpendicular, scaled to unit norm."""
    rotation, position = pose_arrays(world_T_anchor)
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


def orthonormal_basis(m: FloatArray, v: FloatArray, preferred: FloatArray) -> FloatArray:
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
