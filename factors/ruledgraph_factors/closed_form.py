# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A first window's gyroscope bias, velocity, gravity and lines without initial values.

With the image line of a sighting the camera's centre spans a plane, normal n in the body frame,
R n in the body's frame at the window's start. Whatever the translation, all planes of one line hold
its direction d:

    d . R(b) n = 0,

which shows the gyroscope's bias b. With b known, and the camera's centre at
c = v t + a t^2 / 2 + G, G the doubly integrated accelerometer, the line's moment m about the start
obeys

    (d x R n) . (m + d x c) = 0,

linear in m, v and a, which is gravity less the accelerometer's bias. Both are solved by least
squares, weighted anew with a Cauchy loss, as tracks may jump from one edge to another.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph_factors.imu_samples import ImuSamples
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion, preintegrate_frames
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.so3 import exp_and_right_jacobian
from ruledgraph_factors.validation import FloatArray

# Of the Cauchy loss, in standard deviations; rounds of weighting a line's direction, the bias, and
# all lines together.
_CAUCHY, _DIRECTION_ROUNDS, _BIAS_ROUNDS, _ROUNDS = 3.0, 3, 8, 10
# Bias steps below this are none, rad/s.
_CONVERGED = 1e-4
# A direction of the planes' normals is seen when they spread by so many standard deviations.
_SEEN = 1.0
# A priori: velocity (m/s), gravity by the mean specific force (m/s^2), distance of lines (m), which
# are first taken to be so far away and never nearer than that (m).
_VELOCITY_SIGMA, _GRAVITY_SIGMA, _FARTHEST, _TYPICAL, _NEAREST = 3.0, 5.0, 50.0, 2.0, 0.1


@dataclass(frozen=True, eq=False)
class Planes:
    """Of a line: the planes it spans with the camera."""

    frames: Sequence[int]
    """Which frames of the window saw it."""
    normals: FloatArray
    """Unit normals in the body frame, (n, 3)."""
    precision: FloatArray
    """One over the standard deviation of the normals where it is largest, 1/rad, (n,)."""

    @classmethod
    def of(
        cls, frames: Sequence[int], points: GeometricPoints, body_R_cam: FloatArray, sigma: float
    ) -> "Planes":
        """Of a line's points in each frame.

        Args:
            frames: which frames of the window saw it.
            points: there.
            body_R_cam: (3, 3).
            sigma: standard deviation of a point, normalised units.
        """
        _, spread, axes = np.linalg.svd(points.statistics)
        return cls(frames, axes[:, 2] @ body_R_cam.T, spread[:, 1] / sigma)


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """Motion in the body frame at the window's start, and lines there."""

    velocity: FloatArray
    """Of the body, (3,), m/s."""
    gravity: FloatArray
    """Less the accelerometer's bias, (3,), m/s^2."""
    directions: FloatArray
    """Unit, (N, 3)."""
    moments: FloatArray
    """About the body's first position, (N, 3), m."""


def direction_of(line: Planes, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The direction next to all planes, (3,), and the weights with which it was found, (n,).

    `turned` are the body's rotations in the frames that saw it, from the window's start, (n, 3, 3).
    """
    normals = np.einsum("nij,nj->ni", turned, line.normals)
    weights = line.precision
    for _ in range(_DIRECTION_ROUNDS):
        direction = np.linalg.svd(weights[:, None] * normals)[2][2]
        weights = line.precision * _loss_weight(line.precision * (normals @ direction))
    return direction, weights


def gyroscope_bias(
    samples: ImuSamples, times: Sequence[float], lines: Sequence[Planes], sigma: float
) -> FloatArray:
    """The bias (rad/s, (3,)) with which all planes of each line best hold one direction.

    Args:
        samples: of the window.
        times: of its frames, s.
        lines: seen in it.
        sigma: of the bias a priori, rad/s.
    """
    bias = np.zeros(3)
    for _ in range(_BIAS_ROUNDS):
        held = gtsam.imuBias.ConstantBias(np.zeros(3), bias)
        motion = preintegrate_frames(samples, times[0], times, held)
        rotations, right_jacobians = exp_and_right_jacobian(motion.preintegrated[:, :3])
        by_bias = right_jacobians @ motion.bias_jacobian[:, :3, 3:]
        information, gradient = np.eye(3) / sigma**2, bias / sigma**2
        for line in lines:
            turned = rotations[line.frames]
            direction, weights = direction_of(line, turned)
            normals = np.einsum("nij,nj->ni", turned, line.normals)
            residual = weights * (normals @ direction)
            arms = np.cross(line.normals, direction @ turned)
            jacobian = weights[:, None] * np.einsum("nij,ni->nj", by_bias[line.frames], arms)
            # The direction is free to follow.
            by_direction = weights[:, None] * (normals @ _across(direction))
            basis, spread, _ = np.linalg.svd(by_direction, full_matrices=False)
            basis = basis[:, spread > _SEEN]
            jacobian = jacobian - basis @ (basis.T @ jacobian)
            information += jacobian.T @ jacobian
            gradient += jacobian.T @ residual
        step = np.linalg.solve(information, gradient)
        bias = bias - step
        if np.linalg.norm(step) < _CONVERGED:
            break
    return bias


def closed_form(
    motion: FrameMotion,
    lines: Sequence[Planes],
    body_p_cam: FloatArray,
    gravity_magnitude: float = -STANDARD_GRAVITY[2],
) -> ClosedForm:
    """Velocity, gravity and lines of a window.

    Args:
        motion: from the window's start to its frames, with the gyroscope's bias.
        lines: seen in it.
        body_p_cam: position of the camera in the body frame, (3,), m.
        gravity_magnitude: about which gravity is expected, m/s^2.
    """
    rotations, _ = exp_and_right_jacobian(motion.preintegrated[:, :3])
    centres = motion.preintegrated[:, 3:6] + rotations @ body_p_cam
    force = motion.preintegrated[-1, 6:9]
    rough = -gravity_magnitude * force / np.linalg.norm(force)
    elapsed = motion.elapsed
    known = [_Line(line, rotations, centres, elapsed) for line in lines]
    solution = np.zeros(6)
    for _ in range(_ROUNDS):
        information = np.diag(np.repeat([_VELOCITY_SIGMA**-2, _GRAVITY_SIGMA**-2], 3))
        right = np.concatenate([np.zeros(3), rough / _GRAVITY_SIGMA**2])
        for line in known:
            by_motion, target = line.reduced()
            information += by_motion.T @ by_motion
            right += by_motion.T @ target
        solution = np.linalg.solve(information, right)
        for line in known:
            line.update(solution)
    return ClosedForm(
        solution[:3],
        solution[3:],
        np.array([line.direction for line in known]),
        np.array([line.basis @ line.moment for line in known]),
    )


class _Line:
    """One line's equations, (d x R n) . (m + d x c) = 0, a row for each frame that saw it."""

    def __init__(
        self, line: Planes, rotations: FloatArray, centres: FloatArray, elapsed: FloatArray
    ) -> None:
        turned, t = rotations[line.frames], elapsed[line.frames][:, None]
        self.direction, self._precision = direction_of(line, turned)
        self.basis, self.moment = _across(self.direction), np.zeros(2)
        across = np.cross(self.direction, np.einsum("nij,nj->ni", turned, line.normals))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        by_centre = np.cross(across, self.direction)
        self._centres, self._times = centres[line.frames], np.hstack([t, 0.5 * t * t])
        self._by_moment = across @ self.basis
        self._by_motion = np.hstack([by_centre * t, by_centre * (0.5 * t * t)])
        self._target = -np.sum(by_centre * self._centres, axis=1)
        self._weights = self._precision / _TYPICAL

    def reduced(self) -> tuple[FloatArray, FloatArray]:
        """Rows (n, 6) and right-hand side (n,) of the motion, the moment being free to follow."""
        basis, _ = np.linalg.qr(self._rows())
        full = np.column_stack([self._by_motion, self._target]) * self._weights[:, None]
        full = np.vstack([full, np.zeros((2, 7))])
        full = full - basis @ (basis.T @ full)
        return full[:, :6], full[:, 6]

    def update(self, motion: FloatArray) -> None:
        """The moment for a motion (v, a), and new weights: by distance, and by the loss."""
        rest = self._target - self._by_motion @ motion
        right = np.concatenate([self._weights * rest, np.zeros(2)])
        self.moment = np.linalg.lstsq(self._rows(), right, rcond=None)[0]
        centres = self._centres + self._times @ motion.reshape(2, 3)
        planes = self.basis @ self.moment + np.cross(self.direction, centres)
        precision = self._precision / np.maximum(np.linalg.norm(planes, axis=1), _NEAREST)
        residual = self._by_moment @ self.moment - rest
        self._weights = precision * _loss_weight(precision * residual)

    def _rows(self) -> FloatArray:
        """Of the moment, with its prior, (n + 2, 2)."""
        return np.vstack([self._weights[:, None] * self._by_moment, np.eye(2) / _FARTHEST])


def _loss_weight(residual: FloatArray) -> FloatArray:
    """Root of the Cauchy loss's weight of whitened residuals."""
    return np.asarray(1.0 / np.sqrt(1.0 + (residual / _CAUCHY) ** 2))


def _across(direction: FloatArray) -> FloatArray:
    """Two unit vectors across a direction, (3, 2)."""
    return np.asarray(np.linalg.svd(direction[None, :])[2][1:].T)
