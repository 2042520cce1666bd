# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of the body in the world, with exact derivatives."""

from abc import ABC, abstractmethod
from typing import NamedTuple, Protocol

import gtsam
import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation, RotationSpline

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph_factors.so3 import exp_and_right_jacobian


class Motion(ABC):
    """world_T_body(t) from `start` to `stop`, s.

    Velocity, acceleration and angular velocity are the exact derivatives of the pose, so that a
    simulated IMU agrees with the simulated images.
    """

    start: float
    stop: float

    @abstractmethod
    def position(self, times: ArrayLike) -> FloatArray:
        """Body origin in the world, (..., 3), m."""

    @abstractmethod
    def velocity(self, times: ArrayLike) -> FloatArray:
        """Velocity in the world, (..., 3), m/s."""

    @abstractmethod
    def acceleration(self, times: ArrayLike) -> FloatArray:
        """Acceleration in the world, without gravity, (..., 3), m/s^2."""

    @abstractmethod
    def rotation(self, times: ArrayLike) -> FloatArray:
        """world_R_body, (..., 3, 3)."""

    @abstractmethod
    def angular_velocity(self, times: ArrayLike) -> FloatArray:
        """Angular velocity in the body frame, (..., 3), rad/s."""

    def pose(self, time: float) -> gtsam.Pose3:
        """world_T_body at one time."""
        return gtsam.Pose3(gtsam.Rot3(self.rotation(time)), self.position(time))


class SplineMotion(Motion):
    """world_T_body(t) through waypoints.

    Positions follow a quintic spline, orientations scipy's `RotationSpline`.

    Args:
        times: of the waypoints, strictly increasing, (N,), s, N >= 6.
        positions: of the body in the world, (N, 3), m.
        rotation_vectors: orientation world_R_body as rotation vectors, (N, 3), rad.
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike, rotation_vectors: ArrayLike) -> None:
        stamps = np.asarray(times, dtype=np.float64)
        if stamps.size < 6 or np.any(np.diff(stamps) <= 0.0):
            raise RuledgraphError("a spline motion needs at least 6 strictly increasing times")
        self.start = float(stamps[0])
        self.stop = float(stamps[-1])
        self._position = make_interp_spline(stamps, np.asarray(positions, dtype=np.float64), k=5)
        self._velocity = self._position.derivative(1)
        self._acceleration = self._position.derivative(2)
        self._rotation = RotationSpline(stamps, Rotation.from_rotvec(np.asarray(rotation_vectors)))

    def position(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._position(times))

    def velocity(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._velocity(times))

    def acceleration(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._acceleration(times))

    def rotation(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._rotation(times).as_matrix())

    def angular_velocity(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._rotation(times, 1))


class Derivatives(NamedTuple):
    """A vector function of one variable and its first two derivatives, (..., 3) each."""

    value: FloatArray
    first: FloatArray
    second: FloatArray


class Path(Protocol):
    """A vector function of the phase s, with derivatives; s in seconds at full speed."""

    def __call__(self, phase: FloatArray, /) -> Derivatives:
        """At phases (...,)."""


class PathMotion(Motion):
    """A path run through from rest or at full speed.

    Position p(s) and rotation vector theta(s) are functions of a phase s(t). Full speed is s = t.
    From rest, s stays 0 for `REST` seconds and its rate then grows smoothly to 1 within `RAMP`.

    The orientation is world_R_cam = start_R Exp(theta), given for the camera's axes because that is
    what the rotations of an experiment are defined by; the body's follows from the mounting.

    Args:
        position: of the body in the world, m.
        rotation_vector: turn of the camera about its own axes since s = 0, rad.
        world_R_start: the camera's orientation where theta is zero, (3, 3).
        body_R_cam: how the camera is mounted, (3, 3).
        duration: s.
        moving_start: at full speed from the beginning.
    """

    REST = 1.0
    RAMP = 1.0

    def __init__(
        self,
        position: Path,
        rotation_vector: Path,
        world_R_start: FloatArray,
        body_R_cam: FloatArray,
        duration: float,
        moving_start: bool = False,
    ) -> None:
        self.start, self.stop = 0.0, duration
        self._position, self._rotation_vector = position, rotation_vector
        self._world_R_start, self._body_R_cam = world_R_start, body_R_cam
        self._moving_start = moving_start

    def _phase(self, times: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """S and its two derivatives by time, (...,)."""
        t = np.asarray(times, dtype=np.float64)
        if self._moving_start:
            return t, np.ones_like(t), np.zeros_like(t)
        ramp = smooth_step((t - self.REST) / self.RAMP)
        return ramp.integral * self.RAMP, ramp.value, ramp.slope / self.RAMP

    def position(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        s, _, _ = self._phase(times)
        return self._position(s).value

    def velocity(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        s, rate, _ = self._phase(times)
        return self._position(s).first * rate[..., None]

    def acceleration(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        s, rate, rate_slope = self._phase(times)
        path = self._position(s)
        return path.second * rate[..., None] ** 2 + path.first * rate_slope[..., None]

    def rotation(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        s, _, _ = self._phase(times)
        theta = self._rotation_vector(s).value
        turned, _ = exp_and_right_jacobian(theta)
        return np.asarray(self._world_R_start @ turned @ self._body_R_cam.T)

    def angular_velocity(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        s, rate, _ = self._phase(times)
        theta = self._rotation_vector(s)
        _, right_jacobian = exp_and_right_jacobian(theta.value)
        in_cam = np.einsum("...ij,...j->...i", right_jacobian, theta.first * rate[..., None])
        return np.asarray(in_cam @ self._body_R_cam.T)


class Step(NamedTuple):
    """A smooth step, its derivative and its integral from minus infinity."""

    value: FloatArray
    slope: FloatArray
    integral: FloatArray


def smooth_step(x: FloatArray) -> Step:
    """From 0 at x = 0 to 1 at x = 1; its derivative is the raised cosine 1 - cos(2 pi x)."""
    u = np.clip(x, 0.0, 1.0)
    angle = 2.0 * np.pi * u
    return Step(
        u - np.sin(angle) / (2.0 * np.pi),
        1.0 - np.cos(angle),
        0.5 * u * u + (np.cos(angle) - 1.0) / (4.0 * np.pi**2) + np.maximum(x - 1.0, 0.0),
    )
