# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Least squares over the line of a factor alone, the rest of its state standing fast."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ruledgraph_factors.evaluation import Evaluate, evaluation, native_surface
from ruledgraph_factors.kernel import active_kernel
from ruledgraph_factors.ruled_surface import LINE_COLUMNS, State
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray

_MAX_STEPS = 8
_LONGEST_STEP = 1.5
_CONVERGED = 1e-3


class LineMinimum(NamedTuple):
    """Where a descent ended."""

    delta: FloatArray
    """Of the chart, (4,)."""
    cost: float
    hessian: FloatArray
    """Half of the cost's Gauss-Newton Hessian, (4, 4)."""


def fit_line(
    spec: RuledSurfaceSpec,
    state: State,
    starts: Sequence[FloatArray],
    information: float,
    prior: FloatArray,
    descents: int,
) -> LineMinimum:
    """Least c(delta) = information |r(delta)|^2 + sum_i prior_i delta_i^2 by Levenberg-Marquardt.

    Args:
        spec: of a factor without time offset, r its residual. Its noise model has no part.
        state: where all but the line stands.
        starts: deltas, (4,), at least one.
        information: of a residual's row.
        prior: information of delta, (4,).
        descents: how many of the best starts to descend from.
    """
    if active_kernel() == "numpy":
        return fit_line_in_numpy(evaluation(spec), state, starts, information, prior, descents)
    here = state.world_T_body, state.velocity, state.bias, state.gravity
    found = native_surface(spec).fit_line(*here, list(starts), information, prior, descents)
    return LineMinimum(*found)


def fit_line_in_numpy(
    evaluate: Evaluate,
    state: State,
    starts: Sequence[FloatArray],
    information: float,
    prior: FloatArray,
    descents: int,
) -> LineMinimum:
    """The reference of `_native`'s."""

    def sum_of(value: FloatArray, delta: FloatArray) -> float:
        return information * float(value @ value) + float(prior @ delta**2)

    def cost(delta: FloatArray) -> float:
        return sum_of(evaluate(state._replace(line=delta), False).value, delta)

    def linearize(delta: FloatArray) -> tuple[LineMinimum, FloatArray]:
        """With half the gradient, (4,)."""
        value, jacobian = evaluate(state._replace(line=delta), True)
        assert jacobian is not None  # noqa: S101 - it was asked for
        by_line = jacobian[:, LINE_COLUMNS]
        hessian = information * (by_line.T @ by_line)
        hessian.flat[::5] += prior
        gradient = information * (by_line.T @ value) + prior * delta
        return LineMinimum(delta, sum_of(value, delta), hessian), gradient

    def descend(start: FloatArray) -> LineMinimum:
        damping = 1e-3
        fit, gradient = linearize(start)
        for _ in range(_MAX_STEPS):
            damped = fit.hessian.copy()
            damped.flat[::5] *= 1.0 + damping
            step = -np.linalg.solve(damped, gradient)
            step *= min(1.0, _LONGEST_STEP / float(np.linalg.norm(step) + 1e-12))
            tried, slope = linearize(fit.delta + step)
            gained = fit.cost - tried.cost
            if not gained > 0.0:
                damping *= 10.0
                continue
            damping *= 0.2
            fit, gradient = tried, slope
            if gained < _CONVERGED * fit.cost:
                break
        return fit

    best = sorted(starts, key=cost)[:descents]
    return min((descend(start) for start in best), key=lambda fit: fit.cost)
