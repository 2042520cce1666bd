# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""SO(3) for stacks of rotation vectors.

GTSAM's own functions take one rotation a call; the factors need all frames of an interval at once.
Every function accepts leading batch axes, (..., 3) or (..., 3, 3). Conventions are GTSAM's:
Exp(theta + d) = Exp(theta) Exp(Jr(theta) d).
"""

import numpy as np

from ruledgraph_factors.validation import FloatArray

# Below these angles (rad) the closed forms lose digits to cancellation and their power series are
# exact to float64.
_SERIES_ANGLE = 0.3
_INVERSE_SERIES_ANGLE = 0.5
_IDENTITY = np.eye(3)


def hat(v: FloatArray) -> FloatArray:
    """Cross-product matrices [v]x, (..., 3, 3): [v]x w is v x w."""
    result = np.zeros((*v.shape, 3))
    result[..., 0, 1] = -v[..., 2]
    result[..., 0, 2] = v[..., 1]
    result[..., 1, 0] = v[..., 2]
    result[..., 1, 2] = -v[..., 0]
    result[..., 2, 0] = -v[..., 1]
    result[..., 2, 1] = v[..., 0]
    return result


def _scaled(matrix: FloatArray, factor: FloatArray) -> FloatArray:
    return np.asarray(factor[..., None, None] * matrix)


def exp_and_right_jacobian(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations Exp(theta) and their right Jacobians Jr(theta), both (..., 3, 3).

    Exp = I + a K + b K^2 and Jr = I - b K + c K^2 with K = [theta]x, a = sin(t)/t,
    b = (1 - cos t)/t^2, c = (t - sin t)/t^3.
    """
    s = np.einsum("...i,...i->...", theta, theta)
    small = s < _SERIES_ANGLE**2
    angle = np.sqrt(np.where(small, 1.0, s))
    a = np.where(small, _series(s, 6.0, 20.0, 42.0, 72.0, 110.0), np.sin(angle) / angle)
    b = np.where(
        small, 0.5 * _series(s, 12.0, 30.0, 56.0, 90.0, 132.0), (1.0 - np.cos(angle)) / angle**2
    )
    c = np.where(small, _series(s, 20.0, 42.0, 72.0, 110.0, 156.0) / 6.0, (1.0 - a) / angle**2)
    k = hat(theta)
    k2 = theta[..., :, None] * theta[..., None, :] - _scaled(_IDENTITY, s)
    return _IDENTITY + _scaled(k, a) + _scaled(k2, b), _IDENTITY - _scaled(k, b) + _scaled(k2, c)


def _series(s: FloatArray, *divisors: float) -> FloatArray:
    """The alternating series 1 - s/d1 (1 - s/d2 (1 - ...))."""
    total = np.ones_like(s)
    for divisor in reversed(divisors):
        total = 1.0 - s / divisor * total
    return np.asarray(total)


def inverse_right_jacobian(theta: FloatArray) -> FloatArray:
    """Inverse right Jacobians I + K/2 + c K^2, (..., 3, 3), for angles below 2 pi."""
    k = hat(theta)
    c, _ = _inverse_coefficient(theta)
    return np.asarray(_IDENTITY + 0.5 * k + _scaled(k @ k, c))


def inverse_right_jacobian_action_derivative(theta: FloatArray, w: FloatArray) -> FloatArray:
    """Derivative of Jr(theta)^-1 w by theta, (..., 3) x (..., 3) -> (..., 3, 3)."""
    c, slope = _inverse_coefficient(theta)
    dot = np.sum(theta * w, axis=-1)
    double_cross = theta * dot[..., None] - w * np.sum(theta * theta, axis=-1)[..., None]
    outer = theta[..., :, None] * w[..., None, :]
    d_double_cross = _scaled(_IDENTITY, dot) + outer - 2.0 * np.swapaxes(outer, -1, -2)
    gradient = double_cross[..., :, None] * (slope[..., None] * theta)[..., None, :]
    return np.asarray(-0.5 * hat(w) + gradient + _scaled(d_double_cross, c))


def _inverse_coefficient(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """c(t) = 1/t^2 - cot(t/2)/(2t) of Jr^-1, and c'(t)/t."""
    t = np.linalg.norm(theta, axis=-1)
    small = t < _INVERSE_SERIES_ANGLE
    s = np.where(small, t * t, 0.0)
    # Coefficients are |B_2k|/(2k)!, B the Bernoulli numbers.
    series = 1 / 12 + s * (
        1 / 720 + s * (1 / 30240 + s * (1 / 1209600 + s * (1 / 47900160 + s * 691 / 1307674368000)))
    )
    slope_series = 1 / 360 + s * (
        1 / 7560 + s * (1 / 201600 + s * (1 / 5987520 + s * 691 / 130767436800))
    )
    safe = np.where(small, 1.0, t)
    sine = np.sin(safe / 2.0)
    cotangent = np.cos(safe / 2.0) / sine
    closed = 1.0 / safe**2 - cotangent / (2.0 * safe)
    slope_closed = -2.0 / safe**4 + cotangent / (2.0 * safe**3) + 1.0 / (4.0 * safe**2 * sine**2)
    return np.where(small, series, closed), np.where(small, slope_series, slope_closed)
