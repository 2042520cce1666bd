# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Rotation and double integral of the accelerometer, frame by frame (section VII-C, eq. 8)."""

from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph_factors import preintegrate_frames


class Inertial(NamedTuple):
    """A frame in the frame of the first body pose, integrated without gravity, from rest."""

    time: float
    """s."""
    rotation: FloatArray
    """Of the camera, (3, 3)."""
    velocity: FloatArray
    """Integral of the specific force, (3,), m/s."""
    body: FloatArray
    """Double integral of the specific force, (3,), m."""
    centre: FloatArray
    """The same and the camera's place beside the IMU, (3,), m."""


class Derotation:
    """Integrates from frame to frame."""

    def __init__(self, body_T_cam: gtsam.Pose3, gyroscope_bias: FloatArray) -> None:
        self._body_T_cam = body_T_cam
        self.bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyroscope_bias)
        """Of the IMU."""
        self._attitude = np.eye(3)

    def first(self, time: float) -> Inertial:
        """The frame to begin with."""
        return self._inertial(time, np.zeros(3), np.zeros(3))

    def next(self, before: Inertial, time: float, imu: ImuBuffer) -> Inertial:
        """The frame after another, s."""
        samples = imu.between(before.time, time)
        theta, dp, dv = np.split(
            preintegrate_frames(samples, before.time, [time], self.bias).preintegrated[0], 3
        )
        R, dt = self._attitude, time - before.time
        body = before.body + before.velocity * dt + R @ dp
        velocity = before.velocity + R @ dv
        self._attitude = R @ gtsam.Rot3.Expmap(theta).matrix()
        return self._inertial(time, velocity, body)

    def _inertial(self, time: float, velocity: FloatArray, body: FloatArray) -> Inertial:
        rotation = self._attitude @ self._body_T_cam.rotation().matrix()
        centre = body + self._attitude @ self._body_T_cam.translation()
        return Inertial(time, rotation, velocity, body, centre)


def accelerated(start: Inertial, frame: Inertial) -> FloatArray:
    """Gamma from a window's first frame to another, in the first one's camera frame, (3,), m.

    It also holds how the camera moves about the IMU, which rotation makes it do.
    """
    elapsed = frame.time - start.time
    return np.asarray(start.rotation.T @ (frame.centre - start.centre - start.velocity * elapsed))
