# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Tracks of a first window as rays and planes."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.closed_form import Planes, direction_of
from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.ruling import fit_image_line
from ruledgraph_factors.so3 import exp_and_right_jacobian
from ruledgraph_factors.validation import FloatArray, image_points, instance

# The normals of a line's planes have turned when they spread this many times as far as the noise of
# one, and by half a pixel at a focal length of 500 px.
_SIGNIFICANT_TURN = 5.0
_MIN_TURN = 1e-3
# How far beyond infinity noise may put a line, 1/m.
_BEYOND_INFINITY = 0.05


@dataclass(frozen=True, eq=False)
class LineTrack:
    """The edge points of one line over a window."""

    frames: Sequence[int]
    """Which frames of the window's motion saw it, increasing."""
    points: Sequence[ArrayLike]
    """Normalised image coordinates in each of them, (N_i, 2), at least two distinct ones."""


def known_motion(motion: FrameMotion, body_T_cam: gtsam.Pose3) -> tuple[FloatArray, FloatArray]:
    """Rotations of the cameras, and G(t) of their centres, in the body frame at the start."""
    start_R_body, _ = exp_and_right_jacobian(motion.preintegrated[:, :3])
    start_R_cam = start_R_body @ body_T_cam.rotation().matrix()
    return start_R_cam, motion.preintegrated[:, 3:6] + start_R_body @ body_T_cam.translation()


class TrackRays:
    """One track as rays and planes in the body frame at the window's start."""

    def __init__(
        self,
        number: int,
        track: LineTrack,
        motion: FrameMotion,
        body_T_cam: gtsam.Pose3,
        sigma: float,
    ) -> None:
        name = f"tracks[{number}]"
        instance(name, track, LineTrack)
        frames = np.asarray(track.frames)
        if frames.size == 0 or frames.min() < 0 or frames.max() >= len(motion):
            raise FactorError(f"{name}.frames must lie in 0 to {len(motion) - 1}")
        if np.any(np.diff(frames) <= 0):
            raise FactorError(f"{name}.frames must increase")
        if len(track.points) != frames.size:
            raise FactorError(f"{name} has {frames.size} frames, but points of {len(track.points)}")
        self.motion = motion.select(list(frames))
        self.points = [image_points(f"{name}.points[{i}]", p) for i, p in enumerate(track.points)]
        self.start_R_cam, self.known_centres = known_motion(self.motion, body_T_cam)
        self.frame = np.repeat(np.arange(frames.size), [len(p) for p in self.points])
        homogeneous = np.column_stack([np.concatenate(self.points), np.ones(self.frame.size)])
        self.rays = np.einsum("nij,nj->ni", self.start_R_cam[self.frame], homogeneous)

        for i, points in enumerate(self.points):
            fit_image_line(f"{name}.points[{i}]", points)  # raises if they are no line
        body_R_cam = body_T_cam.rotation().matrix()
        compressed = GeometricPoints.from_frames(self.points)
        self.planes = Planes.of(frames.tolist(), compressed, body_R_cam, sigma)
        start_R_body = self.start_R_cam @ body_R_cam.T
        self.direction, _ = direction_of(self.planes, start_R_body)
        weights = self.planes.precision
        normals = np.einsum("nij,nj->ni", start_R_body, self.planes.normals)
        spread = np.linalg.svd(weights[:, None] * normals, compute_uv=False)
        turn = float(spread[1]) if len(spread) > 1 else 0.0
        self.turns = turn > _SIGNIFICANT_TURN * np.sqrt(
            len(weights)
        ) and turn > _MIN_TURN * np.linalg.norm(weights)

    def centres(self, velocity: FloatArray, gravity: FloatArray) -> FloatArray:
        """Camera centre in every frame, (n, 3)."""
        t = self.motion.elapsed[:, None]
        return np.asarray(self.known_centres + t * velocity + 0.5 * t * t * gravity)

    def in_front(self, chart: LineChart, velocity: FloatArray, gravity: FloatArray) -> bool:
        """Whether the line lies in front of the camera, or near infinity, at most points."""
        plucker, _ = chart.plucker(np.zeros(4))
        direction, _ = chart.direction(np.zeros(4))
        moments = plucker[:3] + np.cross(plucker[3:], self.centres(velocity, gravity))
        # x on the ray q with x cross v = m: 1 / depth = |q x d|^2 |v| / (q x d) . m, d = v / |v|.
        across = np.cross(self.rays, direction)
        share = np.sum(across * moments[self.frame], axis=1) / np.sum(across**2, axis=1)
        inverse_depth = float(np.median(plucker[3:] @ direction / share))
        return inverse_depth > -_BEYOND_INFINITY
