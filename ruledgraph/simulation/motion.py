# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Smooth motion through waypoints, with exact derivatives."""

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation, RotationSpline

from ruledgraph.errors import RuledgraphError

FloatArray = NDArray[np.float64]


class SplineMotion:
    """world_T_body(t) through waypoints.

    Positions follow a quintic spline, orientations scipy's `RotationSpline`; acceleration and
    angular velocity are the exact derivatives of these splines, so that a simulated IMU agrees with
    the simulated poses.

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

    def position(self, times: ArrayLike) -> FloatArray:
        """Body origin in the world, (..., 3), m."""
        return np.asarray(self._position(times))

    def velocity(self, times: ArrayLike) -> FloatArray:
        """Velocity in the world, (..., 3), m/s."""
        return np.asarray(self._velocity(times))

    def acceleration(self, times: ArrayLike) -> FloatArray:
        """Acceleration in the world, without gravity, (..., 3), m/s^2."""
        return np.asarray(self._acceleration(times))

    def rotation(self, times: ArrayLike) -> FloatArray:
        """world_R_body, (..., 3, 3)."""
        return np.asarray(self._rotation(times).as_matrix())

    def angular_velocity(self, times: ArrayLike) -> FloatArray:
        """Angular velocity in the body frame, (..., 3), rad/s."""
        return np.asarray(self._rotation(times, 1))

    def pose(self, time: float) -> gtsam.Pose3:
        """world_T_body at one time."""
        return gtsam.Pose3(gtsam.Rot3(self.rotation(time)), self.position(time))
