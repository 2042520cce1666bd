# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""All lines that the frames after one state saw, with a robust loss: their normal equations.

A graph with one state and many lines has a bordered information matrix, and its lines can be
eliminated one by one. With the whitened residual r_c of chunk c of a line's frames and its Jacobian
J_c, the Cauchy loss rho_c and its weight w_c,

    rho_c = k_c^2 / 2 log(1 + |r_c|^2 / k_c^2),   w_c = 1 / (1 + |r_c|^2 / k_c^2),

a line has the loss sum_c rho_c, the gradient sum_c w_c J_c^T r_c and the information
sum_c w_c J_c^T J_c: those of a factor with GTSAM's robust noise for each chunk.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.evaluation import Evaluate, evaluation, native_surface
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.ruled_surface import State
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray

_ROWS = 3  # of a frame
_STATE, _LINE, _TIME = range(15), range(18, 22), range(22, 23)  # columns, without gravity's


class LineEquations(NamedTuple):
    """Of N lines, at a state of n columns: pose (6), velocity (3), bias (6) and, where it is a
    variable, the time offset (1).
    """

    losses: FloatArray
    """(N,)"""
    information: FloatArray
    """(N, n + 4, n + 4), a line's own coordinates last."""
    gradient: FloatArray
    """(N, n + 4)."""


class RobustLines:
    """See the head of this file.

    Args:
        surfaces: of the lines, with compressed points and without extrinsics or focal ratio as a
            variable; keys and noise models have no part.
        sigma: standard deviation of a point, normalised image units.
        chunk: frames of a line that share one loss.
        scales: k_c, in standard deviations, of each chunk of each line.

    Raises:
        FactorError: where extrinsics or the focal ratio are a variable.
    """

    def __init__(
        self,
        surfaces: Sequence[RuledSurfaceSpec],
        sigma: float,
        chunk: int,
        scales: Sequence[FloatArray],
    ) -> None:
        for surface in surfaces:
            if surface.has_extrinsics or surface.has_focal_ratio:
                raise FactorError("extrinsics and focal ratio cannot be variables here")
        self._surfaces = surfaces
        self._precision = 1.0 / sigma
        self._chunk = chunk
        self._scales = scales
        timed = any(surface.has_time_offset for surface in surfaces)
        self._columns = [*_STATE, *(_TIME if timed else ()), *_LINE]
        self._is_native = active_kernel() == "native"
        if self._is_native:
            self._natives = [native_surface(surface) for surface in surfaces]
            self._all_scales = np.concatenate(scales) if scales else np.zeros(0)

    def losses(self, state: State, deltas: FloatArray) -> FloatArray:
        """Of each line, (N,), at deltas (N, 4); the line of `state` has no part."""
        losses = np.empty(len(self._surfaces))
        if self._is_native:
            self._by_native(state, deltas, losses, None, None)
            return losses
        for i in range(len(losses)):
            losses[i] = self._chunks(i, self._residual(i, state, deltas, False)[0])[0]
        return losses

    def equations(self, state: State, deltas: FloatArray) -> LineEquations:
        """The normal equations there."""
        count, size = len(self._surfaces), len(self._columns)
        found = LineEquations(
            np.empty(count), np.empty((count, size, size)), np.empty((count, size))
        )
        if self._is_native:
            self._by_native(state, deltas, *found)
            return found
        for i in range(count):
            residual, jacobian = self._residual(i, state, deltas, True)
            found.losses[i], roots = self._chunks(i, residual)
            rows = self._precision * roots[:, None] * jacobian[:, self._columns]
            found.information[i] = rows.T @ rows
            found.gradient[i] = rows.T @ (roots * residual)
        return found

    def squared_distances(self, state: State, deltas: FloatArray) -> list[FloatArray]:
        """Of each line's points from their rulings, summed by frame, normalised units squared."""
        found = []
        for i in range(len(self._surfaces)):
            residual = self._residual(i, state, deltas, False)[0] / self._precision
            found.append(np.sum(np.square(residual.reshape(-1, _ROWS)), axis=1))
        return found

    @cached_property
    def _evaluations(self) -> list[Evaluate]:
        """Of each line alone."""
        return [evaluation(surface) for surface in self._surfaces]

    def _by_native(
        self,
        state: State,
        deltas: FloatArray,
        losses: FloatArray,
        information: FloatArray | None,
        gradient: FloatArray | None,
    ) -> None:
        native.robust_lines(
            self._natives,
            self._precision,
            self._chunk,
            self._all_scales,
            state.world_T_body,
            state.velocity,
            state.bias,
            state.gravity,
            state.time_shift,
            np.ascontiguousarray(deltas),
            losses,
            information,
            gradient,
        )

    def _residual(
        self, i: int, state: State, deltas: FloatArray, want_jacobian: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Whitened; with the Jacobian, empty unless it is wanted, which is not."""
        value, jacobian = self._evaluations[i](state._replace(line=deltas[i]), want_jacobian)
        return self._precision * value, np.empty((0, 0)) if jacobian is None else jacobian

    def _chunks(self, i: int, residual: FloatArray) -> tuple[float, FloatArray]:
        """The loss, and the root of each row's weight."""
        starts = np.arange(0, len(residual), _ROWS * self._chunk)
        squares = np.square(self._scales[i])
        ratio = np.add.reduceat(residual * residual, starts) / squares
        loss = 0.5 * float(squares @ np.log1p(ratio))
        lengths = np.diff(np.append(starts, len(residual)))
        return loss, np.repeat(1.0 / np.sqrt(1.0 + ratio), lengths)
