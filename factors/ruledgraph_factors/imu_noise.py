# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""White noise of the IMU between a state and its frames, as a part of a factor's noise model.

The errors of the preintegrated motion (theta, p, v), in the state's body frame, follow

    d theta = n_g dt,    d p = v dt,    d v = -[f]x theta dt + n_a dt,

with f the mean specific force: a random walk that all points of a frame, and all lines, share. The
residual of frame j moves by H_j (theta_j, p_j), so that the rows of a factor have the covariance

    S + n H P H^T,

S that of its noise model, P the covariance of the errors at all frames and n the number of lines
that share them. n makes up for their being taken as independent from line to line: n lines
together then know the motion to P, not to P / n (covariance intersection with equal weights). It is
never too little, and of the lines themselves more than needed.
"""

from dataclasses import replace

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.evaluation import evaluation
from ruledgraph_factors.factor import RuledSurfaceFactor, state_at
from ruledgraph_factors.factor_spec import spec_of
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray, positive_number


def with_imu_noise(
    factor: gtsam.NonlinearFactor,
    values: gtsam.Values,
    accelerometer_noise: float,
    gyroscope_noise: float,
    lines: int = 1,
) -> RuledSurfaceFactor:
    """The same factor with the IMU's noise between its state and its frames in the noise model.

    Useful where edges are sharp and states are far apart: see EMBEDDING.md. The covariance
    is that at `values`, a constant; bring along estimates that are about right, and start the line
    with a plain factor first if its distance is a guess.

    Args:
        factor: a ruled-surface factor, also as a graph hands it back; geometric residual, of any
            form with a state; its noise model is not robust and has none of this noise yet.
        values: holds the factor's variables.
        accelerometer_noise: density of the white noise, m/s^2/sqrt(Hz).
        gyroscope_noise: likewise, rad/s/sqrt(Hz).
        lines: how many lines are seen in these frames, n.

    Raises:
        FactorError: naming the argument that is wrong.
    """
    spec = spec_of(factor)
    if not isinstance(spec, RuledSurfaceSpec):
        raise FactorError(f"factor must be a ruled-surface factor, not a {type(factor).__name__}")
    if spec.has_imu_noise:
        raise FactorError(
            "factor: its noise model has the IMU's noise already; pass the factor without it"
        )
    if not isinstance(spec.points, GeometricPoints) or spec.form == "pose":
        raise FactorError("factor must be of geometric points and of a state")
    if not isinstance(spec.noise_model, noiseModel.Gaussian):
        raise FactorError("factor: its noise model must be Gaussian, not robust")
    if lines < 1:
        raise FactorError(f"lines must be at least 1, got {lines}")
    accelerometer = positive_number("accelerometer_noise", accelerometer_noise)
    gyroscope = positive_number("gyroscope_noise", gyroscope_noise)
    keys = list(spec.keys)
    found = evaluation(spec)(state_at(spec, keys, values), True)
    assert found.jacobian is not None  # noqa: S101 - it was asked for
    by_pose = found.jacobian[:, :6].reshape(-1, 3, 6)
    # A pose X moved by (theta, t) on the right takes the frame along: p = t + theta x dp.
    by_error = by_pose.copy()
    by_error[:, :, :3] += by_pose[:, :, 3:] @ hat(spec.motion.preintegrated[:, 3:6])
    motion = motion_covariance(spec.motion, accelerometer, gyroscope)
    count = len(by_error)
    shared = np.einsum("iab,ibjc,jdc->iajd", by_error, motion, by_error)
    covariance = spec.noise_model.covariance() + lines * shared.reshape(3 * count, 3 * count)
    noise = noiseModel.Gaussian.Covariance(0.5 * (covariance + covariance.T), False)
    return RuledSurfaceFactor(replace(spec, noise_model=noise, has_imu_noise=True))


def motion_covariance(
    motion: FrameMotion, accelerometer_noise: float, gyroscope_noise: float
) -> FloatArray:
    """P, covariance of the errors (theta, p) of all frames, (n, 6, n, 6), rad and m."""
    count = len(motion)
    noise = np.repeat([gyroscope_noise**2, 0.0, accelerometer_noise**2], 3)
    walk = np.zeros((9, 9))
    walk[3:6, 6:] = np.eye(3)
    last = max(float(motion.elapsed[-1]), 1e-9)
    walk[6:, :3] = -hat(motion.preintegrated[-1, 6:] / last)
    covariance, found = np.zeros((9, 9)), np.zeros((count, 6, count, 6))
    before = 0.0
    across = np.zeros((count, 9, 9))  # of frames so far and the one at hand
    for j, now in enumerate(motion.elapsed):
        step = float(now) - before
        move = _transition(walk, step)
        # Simpson's rule is exact but for terms of the sixth order in the step.
        half = _transition(walk, 0.5 * step)
        added = (
            step / 6.0 * (np.diag(noise) + 4.0 * (half * noise) @ half.T + (move * noise) @ move.T)
        )
        covariance = move @ covariance @ move.T + added
        across[:j] = across[:j] @ move.T
        across[j] = covariance
        found[: j + 1, :, j] = across[: j + 1, :6, :6]
        found[j, :, : j + 1] = across[: j + 1, :6, :6].transpose(2, 0, 1)
        before = float(now)
    return found


def _transition(walk: FloatArray, step: float) -> FloatArray:
    """Exp(walk step): its third power is zero."""
    return np.asarray(np.eye(9) + step * walk + 0.5 * step**2 * (walk @ walk))
