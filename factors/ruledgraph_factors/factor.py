# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The point-to-ruled-surface factor as GTSAM sees it; `factories` builds it."""

from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.evaluation import Evaluate, Write, evaluation, jacobian_room, writing
from ruledgraph_factors.observations import CompressedPoints
from ruledgraph_factors.ruled_surface import State
from ruledgraph_factors.spec import Form, RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray

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


class RuledSurfaceFactor(gtsam.CustomFactor):
    """The factor that a spec describes.

    As long as Python holds this object, it can be pickled, copied and cloned. What GTSAM hands
    back from a graph after Python has let go of it is a plain `CustomFactor` that still works but
    cannot; keep the `spec`.
    """

    def __init__(self, spec: RuledSurfaceSpec) -> None:
        write = writing(spec)
        super().__init__(spec.noise_model, list(spec.keys), _ErrorFunction(spec, write))
        self.spec = spec
        """The plain data this factor was built from."""
        self.evaluate: Evaluate = evaluation(spec, write)
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
        jacobian = jacobian_room(spec)
        return cls(jacobian, [jacobian[:, columns] for columns in _COLUMNS[spec.form]])


class _ErrorFunction:
    """The callback GTSAM keeps. It holds no reference to the factor: that would be a cycle through
    C++ which Python's collector cannot see.
    """

    def __init__(self, spec: RuledSurfaceSpec, write: Write) -> None:
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
