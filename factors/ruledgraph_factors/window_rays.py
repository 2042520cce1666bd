# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Tracks of a first window as rays and planes, and the linear solution for them.

The equations are those of `first_window`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.ruling import fit_image_line
from ruledgraph_factors.so3 import exp_and_right_jacobian
from ruledgraph_factors.validation import FloatArray, image_points, instance

# The normals of a line's planes have turned when they spread this many times as far as the noise of
# one, and by half a pixel at a focal length of 500 px.
_SIGNIFICANT_TURN = 5.0
_LEAST_TURN = 1e-3
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

        normals, precisions = [], []
        for i, points in enumerate(self.points):
            line, _ = fit_image_line(f"{name}.points[{i}]", points)
            size = np.linalg.norm(line)
            normals.append(self.start_R_cam[i] @ line / size)
            # Standard deviation of a normal: sigma |n_xy| sqrt(1/s1^2 + 1/s2^2), s singular values.
            s = np.linalg.svd(np.column_stack([points, np.ones(len(points))]), compute_uv=False)
            precisions.append(size / (sigma * np.hypot(1.0 / s[0], 1.0 / s[1])))
        weights = np.array(precisions)
        _, spread, axes = np.linalg.svd(weights[:, None] * np.array(normals), full_matrices=True)
        self.direction: FloatArray = np.asarray(axes[2])
        turn = float(spread[1]) if len(spread) > 1 else 0.0
        self.turns = turn > _SIGNIFICANT_TURN * np.sqrt(
            len(weights)
        ) and turn > _LEAST_TURN * np.linalg.norm(weights)

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


def solve_linear(
    sights: Sequence[TrackRays],
) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """Moments (perpendicular to their directions), velocity, gravity: q.m + (q x d).c(t) = 0."""
    count = len(sights)
    bases, rows, targets = [], [], []
    for i, sight in enumerate(sights):
        basis = np.linalg.svd(sight.direction[None, :])[2][1:].T
        across = np.cross(sight.rays, sight.direction)
        t = sight.motion.elapsed[sight.frame][:, None]
        block = np.zeros((len(across), 2 * count + 6))
        block[:, 2 * i : 2 * i + 2] = sight.rays @ basis
        block[:, -6:-3] = across * t
        block[:, -3:] = across * (0.5 * t * t)
        bases.append(basis)
        rows.append(block)
        targets.append(-np.sum(across * sight.known_centres[sight.frame], axis=1))
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=None)[0]
    moments = [basis @ solution[2 * i : 2 * i + 2] for i, basis in enumerate(bases)]
    return moments, solution[-6:-3], solution[-3:]
