# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The frames of a window, and the surfaces estimated from their points."""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.baselines.paper.derotation import Inertial, accelerated
from ruledgraph.baselines.paper.surfaces import Points, Surfaces
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import LineEstimate

# Share of a line's points beyond the reported ends.
_STRAY = 0.05
# Depth of a ray of unit depth after derotation, at least: 87 degrees off the axis.
_MIN_AHEAD = 0.05
# A line with fewer points is not seen in a frame.
_MIN_POINTS = 3


class Rulings(NamedTuple):
    """The lines of a window, in the world."""

    stamp: int
    """Of the window's first frame, ns."""
    ends: FloatArray
    """Two points of each line, 1 m apart, (M, 2, 3), m."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame of the window."""

    stamp: int
    inertial: Inertial
    points: list[FloatArray]
    """The points of each line, normalised, not derotated, (n, 2)."""

    @property
    def lines(self) -> int:
        """How many lines have points."""
        return sum(len(points) >= _MIN_POINTS for points in self.points)


@dataclass(eq=False)
class Window:
    """Frames, and the surfaces estimated from their points, in the first one's camera frame."""

    frames: deque[Seen]
    surfaces: Surfaces
    level: FloatArray
    """world_R_first, of the frame of the first body pose, (3, 3)."""
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Of the window's first camera in that frame, (3,), m."""

    @property
    def lines(self) -> FloatArray:
        """X0 of the lines, (M, 3), m."""
        return self.surfaces.X0

    def displacement(self, frame: Seen) -> FloatArray:
        """X(t) at a frame, (3,), m."""
        first = self.frames[0].inertial
        elapsed = np.array([frame.inertial.time - first.time])
        X = self.surfaces.displacement(elapsed, accelerated(first, frame.inertial)[None])
        return np.asarray(X[0])

    def velocity(self, frame: Seen) -> FloatArray:
        """Derivative of X(t) at a frame as the IMU, not the camera, sees it, (3,), m/s."""
        first, now = self.frames[0].inertial, frame.inertial
        gained = first.rotation.T @ (now.velocity - first.velocity)
        elapsed = now.time - first.time
        velocity = self.surfaces.velocity - gained + elapsed * self.surfaces.gravity
        return np.asarray(velocity)

    def derotated(self, points: FloatArray, frame: Inertial) -> FloatArray:
        """Points (N, 2) of a frame as the first frame's camera would see their rays, (N, 2)."""
        R = self.frames[0].inertial.rotation.T @ frame.rotation
        rays = points @ R[:, :2].T + R[:, 2]
        return np.asarray(rays[:, :2] / np.where(rays[:, 2:] > _MIN_AHEAD, rays[:, 2:], np.nan))

    def points(self) -> Points:
        """All points that the first frame's camera has before it."""
        first = self.frames[0].inertial
        times = np.array([frame.inertial.time - first.time for frame in self.frames])
        gammas = np.array([accelerated(first, frame.inertial) for frame in self.frames])
        rotations = np.array([first.rotation.T @ f.inertial.rotation for f in self.frames])
        count = len(self.frames)
        sizes = np.array([[len(p) for p in frame.points] for frame in self.frames]).T
        number = np.repeat(np.tile(np.arange(count), len(sizes)), sizes.ravel())
        line = np.repeat(np.arange(len(sizes)), sizes.sum(axis=1))
        p = np.concatenate([f.points[i] for i in range(len(sizes)) for f in self.frames])
        R = rotations[number]
        rays = R[:, :, 0] * p[:, :1] + R[:, :, 1] * p[:, 1:] + R[:, :, 2]
        ahead = rays[:, 2] > _MIN_AHEAD
        rays, line, number = rays[ahead], line[ahead], number[ahead]
        return Points(rays[:, :2] / rays[:, 2:], line, times[number], gammas[number])

    def slide(self) -> None:
        """Forget the first frame and move everything to the second's camera frame."""
        old, second = self.frames[0].inertial, self.frames[1]
        X, velocity, surfaces = self.displacement(second), self.velocity(second), self.surfaces
        turn = second.inertial.rotation.T @ old.rotation
        self.position = self.position - old.rotation @ X
        V0 = surfaces.V0 @ turn.T
        S = (surfaces.X0 + X) @ turn.T
        X0 = S - np.sum(S * V0, axis=1, keepdims=True) * V0
        self.surfaces = Surfaces(X0, V0, turn @ velocity, turn @ surfaces.gravity)
        self.frames.popleft()

    def world_T_cam(self, frame: Seen) -> gtsam.Pose3:
        """The pose of a frame's camera."""
        first = self.frames[0].inertial
        position = self.position - first.rotation @ self.displacement(frame)
        rotation = gtsam.Rot3(self.level @ frame.inertial.rotation)
        return gtsam.Pose3(rotation, self.level @ position)

    def world_velocity(self, frame: Seen) -> FloatArray:
        """Of a frame's camera in the world, (3,), m/s."""
        return -self.level @ self.frames[0].inertial.rotation @ self.velocity(frame)

    def rulings(self) -> Rulings:
        """The lines in the world."""
        first = self.frames[0]
        R = self.level @ first.inertial.rotation
        X0, V0 = self.surfaces.X0, self.surfaces.V0
        ends = np.stack([X0, X0 + V0], axis=1)
        return Rulings(first.stamp, ends @ R.T + self.level @ self.position)

    def line_estimates(self, rulings: Rulings) -> list[LineEstimate]:
        """The lines, in the world, as far as their points in the window reach, alpha of eq. 15."""
        points, lines = self.points(), []
        alpha = self.surfaces.alpha(points)
        foot, beyond = rulings.ends.transpose(1, 0, 2)
        for i in range(len(foot)):
            own = alpha[points.line == i]
            if not len(own):
                continue
            extent = np.quantile(own, [_STRAY, 1.0 - _STRAY])
            lines.append(
                LineEstimate(
                    id=i,
                    ends=foot[i] + extent[:, None] * (beyond[i] - foot[i]),
                    joint_covariance=np.full((6, 6), np.nan),
                    first_stamp=self.frames[0].stamp,
                    last_stamp=self.frames[-1].stamp,
                    points=len(own),
                )
            )
        return lines
