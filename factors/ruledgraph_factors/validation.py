# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Checks on what callers pass in; every message names the argument at fault."""

import math
import operator
from functools import lru_cache
from typing import Any, TypeAlias

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruledgraph_factors.errors import FactorError

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]

# Rotations built from float32 or from six printed digits pass; a scaled or mirrored one does not.
ORTHONORMAL_TOLERANCE = 1e-5
# 87 degrees off the optical axis; pixels are beyond it almost everywhere.
LARGEST_IMAGE_COORDINATE = 20.0
# Times that differ by less are the same: 1 us is four steps of a Unix time in float64.
SAME_TIME = 1e-6
_IDENTITY = np.eye(3)


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """`value` as a read-only float64 array of `shape` (None: any length), all finite."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise FactorError(f"{name} must be numbers: {error}") from None
    if array.shape != shape and not _fits(array.shape, shape):
        wanted = str(tuple("N" if length is None else length for length in shape)).replace("'", "")
        raise FactorError(f"{name} must have shape {wanted}, not {array.shape}")
    # Of small arrays a sum of squares takes a third of the time; what it says of huge values, that
    # they are infinite, is looked at again.
    if not math.isfinite(np.vdot(array, array)):
        for at in np.argwhere(~np.isfinite(array)):
            where = ", ".join(str(int(i)) for i in at)
            raise FactorError(f"{name} has a NaN or infinite value at [{where}]")
    array.setflags(write=False)
    return array


def _fits(found: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    if len(found) != len(shape):
        return False
    # Not by `all`: its generator takes longer than the other checks together.
    for have, want in zip(found, shape, strict=True):
        if want is not None and have != want:
            return False
    return True


def image_points(name: str, value: ArrayLike) -> FloatArray:
    """`value` as normalised image points (N, 2)."""
    points = finite_array(name, value, (None, 2))
    if points.size and float(np.abs(points).max()) > LARGEST_IMAGE_COORDINATE:
        raise FactorError(
            f"{name} reaches {float(np.abs(points).max()):g}: image points must be normalised, "
            "(X/Z, Y/Z), not pixels"
        )
    return points


def number(name: str, value: float) -> float:
    """`value` as a finite float."""
    if isinstance(value, float) and math.isfinite(value):
        return value
    return float(finite_array(name, value, ()))


def positive_number(name: str, value: float) -> float:
    """`value` as a finite float above zero."""
    result = number(name, value)
    if result <= 0.0:
        raise FactorError(f"{name} must be positive, not {result:g}")
    return result


def increasing_times(name: str, value: ArrayLike) -> FloatArray:
    """`value` as a non-empty, strictly increasing array of seconds."""
    times = finite_array(name, value, (None,))
    if times.size == 0:
        raise FactorError(f"{name} is empty")
    steps = times[1:] - times[:-1]  # of few times `np.diff` takes four times as long
    if (steps <= 0.0).any():
        at = int(np.argmax(steps <= 0.0))
        raise FactorError(
            f"{name} must increase strictly, but {name}[{at + 1}] = {times[at + 1]:.9f} "
            f"follows {name}[{at}] = {times[at]:.9f}"
        )
    return times


def rotation_matrix(name: str, value: ArrayLike) -> FloatArray:
    """`value` as a 3x3 rotation matrix."""
    matrix = finite_array(name, value, (3, 3))
    defect = float(np.abs(matrix @ matrix.T - _IDENTITY).max())
    if defect > ORTHONORMAL_TOLERANCE:
        raise FactorError(
            f"{name}: its rotation is not orthonormal (R R^T differs from I by {defect:.1e})"
        )
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    if a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) < 0.0:
        raise FactorError(f"{name}: its rotation is a reflection (determinant -1)")
    return matrix


def pose(name: str, value: gtsam.Pose3) -> gtsam.Pose3:
    """`value`, after checking that it is a finite rigid motion."""
    if not isinstance(value, gtsam.Pose3):
        raise FactorError(
            f"{name} must be a gtsam.Pose3, not {type(value).__name__} "
            "(a 4x4 matrix is wrapped by gtsam.Pose3(matrix))"
        )
    _require_rigid(name, value)
    return value


@lru_cache(maxsize=64)
def _require_rigid(name: str, value: gtsam.Pose3) -> None:
    """Remembers the last poses: all factors of a camera share its extrinsic, and new lines that of
    the frames they are anchored in.
    """
    matrix = finite_array(name, value.matrix(), (4, 4))
    rotation_matrix(name, matrix[:3, :3])


def vector_of(values: gtsam.Values, key: int, size: int) -> FloatArray:
    """The vector under a key, after checking its size."""
    vector = values.atVector(key)
    if vector.size != size:
        name = gtsam.DefaultKeyFormatter(key)
        raise FactorError(f"{name} must hold a vector of {size}, not of {vector.size}")
    return vector


def graph_key(name: str, value: int) -> int:
    """`value` as a GTSAM key, an integer from 0 to 2**64 - 1."""
    try:
        key = operator.index(value)
    except TypeError:
        key = -1
    found = repr(value) if isinstance(value, int | float) else f"a {type(value).__name__}"
    if isinstance(value, bool) or not 0 <= key < 2**64:
        raise FactorError(
            f"{name} must be an integer GTSAM key such as symbol_shorthand.X(0), not {found}"
        )
    return key


def instance(name: str, value: Any, kind: type) -> None:
    """Raise unless `value` is a `kind`."""
    if not isinstance(value, kind):
        raise FactorError(f"{name} must be a {kind.__name__}, not {type(value).__name__}")
