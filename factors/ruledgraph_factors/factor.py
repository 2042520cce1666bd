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
from ruledgraph_factors.ruled_surface import (
    EXTRINSICS_COLUMNS,
    FOCAL_COLUMNS,
    LINE_COLUMNS,
    State,
)
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray, positive_number, vector_of

_NO_VELOCITY, _NO_BIAS = np.zeros(3), np.zeros(6)
# The columns of the residual's Jacobian that belong to each key, but for those at its end.
_COLUMNS = {
    "pose_key": slice(0, 6),
    "velocity_key": slice(6, 9),
    "bias_key": slice(9, 15),
    "gravity_key": slice(15, 18),
    "line_key": LINE_COLUMNS,
    "time_key": slice(22, 23),
}


def _columns(spec: RuledSurfaceSpec) -> list[slice]:
    """Of each key."""
    focal = FOCAL_COLUMNS if spec.has_focal_ratio else 0
    at_end = {
        "extrinsics_key": slice(-EXTRINSICS_COLUMNS - focal, -focal or None),
        "focal_key": slice(-FOCAL_COLUMNS, None),
    }
    return [(_COLUMNS | at_end)[name] for name in spec.key_names]


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
        return cls(jacobian, [jacobian[:, columns] for columns in _columns(spec)])


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
    velocity, bias, gravity = _NO_VELOCITY, _NO_BIAS, spec.gravity
    if form != "pose":
        velocity = vector_of(values, keys[1], 3)
        bias = values.atConstantBias(keys[2]).vector()
        if form == "node_gravity_direction":
            direction = values.atUnit3(keys[3]).unitVector()
            gravity = float(np.linalg.norm(gravity)) * direction
        elif form == "node_gravity_vector":
            gravity = vector_of(values, keys[3], 3)
    time_shift, camera, focal_ratio = 0.0, None, None
    variables = spec.camera_variables
    for name, key in zip(variables, keys[-1 - len(variables) : -1], strict=True):
        if name == "time":
            time_shift = values.atDouble(key)
        elif name == "extrinsics":
            camera = values.atPose3(key).matrix()
        else:
            focal_ratio = values.atDouble(key)
    pose, line = values.atPose3(keys[0]).matrix(), vector_of(values, keys[-1], 4)
    return State(pose, velocity, bias, gravity, line, time_shift, camera, focal_ratio)
