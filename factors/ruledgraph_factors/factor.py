# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The point-to-ruled-surface factor as GTSAM sees it; `factories` builds it."""

import math
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph_factors.evaluation import (
    Evaluate,
    Write,
    evaluation,
    jacobian_buffer,
    writing,
)
from ruledgraph_factors.factor_spec import ErrorFunction, SpecFactor
from ruledgraph_factors.ruled_surface import State
from ruledgraph_factors.spec import Form, RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray, positive_number, vector_of

_POSE, _VELOCITY, _BIAS = slice(0, 6), slice(6, 9), slice(9, 15)
_GRAVITY, _LINE, _TIME, _CAMERA = slice(15, 18), slice(18, 22), slice(22, 23), slice(-6, None)
_NO_VELOCITY, _NO_BIAS = np.zeros(3), np.zeros(6)
# The columns of the residual's Jacobian that belong to each key.
_COLUMNS: dict[Form, tuple[slice, ...]] = {
    "node": (_POSE, _VELOCITY, _BIAS, _LINE),
    "node_time_offset": (_POSE, _VELOCITY, _BIAS, _TIME, _LINE),
    "node_extrinsics": (_POSE, _VELOCITY, _BIAS, _CAMERA, _LINE),
    "node_time_offset_extrinsics": (_POSE, _VELOCITY, _BIAS, _TIME, _CAMERA, _LINE),
    "node_gravity_direction": (_POSE, _VELOCITY, _BIAS, _GRAVITY, _LINE),
    "node_gravity_vector": (_POSE, _VELOCITY, _BIAS, _GRAVITY, _LINE),
    "pose": (_POSE, _LINE),
    "pose_extrinsics": (_POSE, _CAMERA, _LINE),
}


class RuledSurfaceFactor(SpecFactor):
    """The factor that a spec describes."""

    spec: RuledSurfaceSpec

    def __init__(self, spec: RuledSurfaceSpec) -> None:
        self._function = _RuledSurfaceError(spec)
        super().__init__(spec, self._function)
        self.evaluate: Evaluate = evaluation(spec, self._function.write)
        """The residual, and its Jacobian if asked for, at any state, without a graph or weight."""

    @property
    def weight(self) -> float:
        """For reweighted least squares, 1 unless set: to GTSAM the residual is its root times r.

        A new one counts from the next linearization on. It is not part of the spec: copies begin
        with 1.

        Raises:
            FactorError: for one that is not positive and finite, when set.
        """
        return self._function.root_weight**2

    @weight.setter
    def weight(self, weight: float) -> None:
        self._function.root_weight = math.sqrt(positive_number("weight", weight))


class _Buffer(NamedTuple):
    """A Jacobian, and views of the columns of each key."""

    jacobian: FloatArray
    blocks: list[FloatArray]

    @classmethod
    def of(cls, spec: RuledSurfaceSpec) -> "_Buffer":
        jacobian = jacobian_buffer(spec)
        return cls(jacobian, [jacobian[:, columns] for columns in _COLUMNS[spec.form]])


class _RuledSurfaceError(ErrorFunction):
    spec: RuledSurfaceSpec

    def __init__(self, spec: RuledSurfaceSpec) -> None:
        super().__init__(spec)
        self.write: Write = writing(spec)
        self.root_weight = 1.0
        self._magnitude = float(np.linalg.norm(spec.gravity))
        # GTSAM copies the blocks, so buffers are reused; a thread takes one out while it works.
        self._buffers: list[_Buffer] = []

    def error(
        self, keys: list[int], values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        spec, write = self.spec, self.write
        state = state_at(spec, keys, values)
        value = np.empty(spec.rows)
        if H is None:
            write(state, value, None)
            return value * self.root_weight
        try:
            buffer = self._buffers.pop()
        except IndexError:
            buffer = _Buffer.of(spec)
        write(state, value, buffer.jacobian)
        if self.root_weight != 1.0:
            value *= self.root_weight
            buffer.jacobian[:] *= self.root_weight
        for i, block in enumerate(buffer.blocks):
            H[i] = block
        if spec.form == "node_gravity_direction":
            basis = values.atUnit3(keys[3]).basis()
            H[3] = np.asfortranarray(buffer.blocks[3] @ (self._magnitude * basis))
        self._buffers.append(buffer)
        return value


def state_at(spec: RuledSurfaceSpec, keys: list[int], values: gtsam.Values) -> State:
    """What a factor depends on.

    Raises:
        FactorError: when a key holds a vector of the wrong size.
    """
    form = spec.form
    velocity, bias, gravity, time_shift = _NO_VELOCITY, _NO_BIAS, spec.gravity, 0.0
    if form not in ("pose", "pose_extrinsics"):
        velocity = vector_of(values, keys[1], 3)
        bias = values.atConstantBias(keys[2]).vector()
        if form == "node_gravity_direction":
            direction = values.atUnit3(keys[3]).unitVector()
            gravity = float(np.linalg.norm(gravity)) * direction
        elif form == "node_gravity_vector":
            gravity = vector_of(values, keys[3], 3)
        elif spec.has_time_offset:
            time_shift = values.atDouble(keys[3])
    pose, line = values.atPose3(keys[0]).matrix(), vector_of(values, keys[-1], 4)
    camera = values.atPose3(keys[-2]).matrix() if spec.has_extrinsics else None
    return State(pose, velocity, bias, gravity, line, time_shift, camera)
