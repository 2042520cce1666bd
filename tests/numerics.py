# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Numerical derivatives for the tests, and GTSAM values to take them at."""

import contextlib
from collections.abc import Callable

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray

# Weights of the 4-point central difference: error of order step^4.
_STENCIL = ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))


def derivative(function: Callable[[FloatArray], FloatArray], at: FloatArray, step: float):
    """d function / d vector at `at`, shape (*value, len(at))."""
    columns = []
    for axis in np.eye(len(at)):
        total = sum(w * np.asarray(function(at + k * step * axis)) for k, w in _STENCIL)
        columns.append(total / (12.0 * step))
    return np.stack(columns, axis=-1)


def relative_error(analytic: FloatArray, numeric: FloatArray) -> float:
    """Largest difference over the larger of the two's greatest entry."""
    scale = max(np.abs(analytic).max(), np.abs(numeric).max())
    return float(np.abs(analytic - numeric).max() / scale) if scale > 0.0 else 0.0


def read(values: gtsam.Values, key: int):
    """The value under `key`, whatever its type."""
    for getter in (values.atPose3, values.atConstantBias, values.atUnit3, values.atDouble):
        with contextlib.suppress(RuntimeError):
            return getter(key)
    return values.atVector(key)


def dimension(value) -> int:
    """Of the tangent space."""
    if isinstance(value, np.ndarray):
        return len(value)
    if isinstance(value, float):
        return 1
    return 2 if isinstance(value, gtsam.Unit3) else 6


def factor_jacobians(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> dict[int, FloatArray]:
    """Unwhitened Jacobians by key, from the factor's own linearisation with unit noise."""
    linear = factor.linearize(values)
    matrix = linear.jacobian()[0]
    result, column = {}, 0
    for key in linear.keys():  # noqa: SIM118 - a GTSAM factor is no dict
        width = dimension(read(values, key))
        result[key] = matrix[:, column : column + width]
        column += width
    return result


def numerical_jacobian(
    factor: gtsam.NonlinearFactor, values: gtsam.Values, key: int, step: float
) -> FloatArray:
    """d unwhitenedError / d tangent of one key, evaluated without Jacobians requested."""

    def residual(tangent: FloatArray) -> FloatArray:
        # By GTSAM's own retraction, as a whole: to update a value takes its Python wrapper longer.
        step_of_key = gtsam.VectorValues()
        step_of_key.insert(key, tangent)
        return factor.unwhitenedError(values.retract(step_of_key))

    return derivative(residual, np.zeros(dimension(read(values, key))), step)
