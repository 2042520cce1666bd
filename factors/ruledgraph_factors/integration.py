# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Preintegration step by step, in numpy: see `motion`, whose `preintegrate_frames` calls it."""

import numpy as np

from ruledgraph_factors.so3 import (
    exp_and_right_jacobian,
    hat,
    inverse_right_jacobian,
    inverse_right_jacobian_action_derivative,
)
from ruledgraph_factors.validation import FloatArray


def segments_in_numpy(
    times: FloatArray, force: FloatArray, rate: FloatArray, breaks: list[float], bias: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cut samples into segments; the reference of `_native.segments`.

    Args:
        times: of the samples, (N,), s.
        force: accelerometer, (N, 3), m/s^2.
        rate: gyroscope, (N, 3), rad/s.
        breaks: in any order, within the samples; from the first to the last there will be one at
            every sample, too, s.
        bias: (6,), see `ImuSamples.segments`.

    Returns:
        Breaks (n + 1,), force (n, 3) and rate (n, 3) of the n segments.
    """
    start, stop = min(breaks), max(breaks)
    inside = times[(times > start) & (times < stop)]
    all_breaks = np.unique(np.concatenate([breaks, inside]))
    mean_force = _midpoints(all_breaks, times, force)
    mean_rate = _midpoints(all_breaks, times, rate)
    lengths = np.diff(all_breaks)[:, None]
    half_turn, _ = exp_and_right_jacobian(0.5 * lengths * (mean_rate - bias[3:]))
    turned = np.einsum("nij,nj->ni", half_turn, mean_force - bias[:3]) + bias[:3]
    return all_breaks, turned, mean_rate


def _midpoints(breaks: FloatArray, times: FloatArray, signal: FloatArray) -> FloatArray:
    at_breaks = np.stack([np.interp(breaks, times, column) for column in signal.T], axis=1)
    return np.asarray(0.5 * (at_breaks[1:] + at_breaks[:-1]))


def integrate_in_numpy(
    force: FloatArray, rate: FloatArray, dt: FloatArray, delta: FloatArray, d_bias: FloatArray
) -> int:
    """Preintegrate n segments; the reference of `_native.integrate`.

    Args:
        force: accelerometer without bias, (n, 3), m/s^2.
        rate: gyroscope without bias, (n, 3), rad/s.
        dt: lengths of the segments, (n,), s.
        delta: written, (theta, dp, dv) before the first segment and after each, (n + 1, 9).
        d_bias: written, its derivative by the bias, (n + 1, 9, 6).

    Returns:
        The last state written: n, or the first where the body has turned by more than pi.
    """
    delta[0], d_bias[0] = 0.0, 0.0
    for i, segment in enumerate(zip(force, rate, dt.tolist(), strict=True)):
        if delta[i, :3] @ delta[i, :3] > np.pi**2:
            return i
        delta[i + 1], d_bias[i + 1] = _integrate(delta[i], d_bias[i], *segment)
    return len(dt)


def _integrate(
    delta: FloatArray, d_bias: FloatArray, force: FloatArray, rate: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray]:
    """One Euler step of (theta, dp, dv) and of its derivative by the bias."""
    theta, position, velocity = delta[:3], delta[3:6], delta[6:]
    rotation, right_jacobian = exp_and_right_jacobian(theta)
    inverse_jacobian = inverse_right_jacobian(theta)
    acceleration = rotation @ force

    d_theta, d_position, d_velocity = d_bias[:3], d_bias[3:6], d_bias[6:]
    d_acceleration = -rotation @ hat(force) @ right_jacobian @ d_theta
    d_acceleration[:, :3] -= rotation
    d_rate = inverse_right_jacobian_action_derivative(theta, rate) @ d_theta
    d_rate[:, 3:] -= inverse_jacobian

    return (
        np.concatenate(
            [
                theta + inverse_jacobian @ rate * dt,
                position + velocity * dt + acceleration * (0.5 * dt * dt),
                velocity + acceleration * dt,
            ]
        ),
        np.concatenate(
            [
                d_theta + d_rate * dt,
                d_position + d_velocity * dt + d_acceleration * (0.5 * dt * dt),
                d_velocity + d_acceleration * dt,
            ]
        ),
    )
