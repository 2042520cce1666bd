# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How the camera moves while a rolling shutter reads the rows of one image.

Row y is exposed at t = (y - (height - 1) / 2) line_delay from the middle row, whose time is the
frame's. A ray r seen then points along

    r_middle = Exp(phi(t)) r

in the axes of the camera at the middle row; phi is the gyroscope's. What is left is the camera's
translation c(t). It moves a line's ruling across itself, by a distance that is affine along it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.frontend.edge_search import normal_of

# A row is where the point is that was moved to that row's time, found by repetition: each divides
# what the row is off by the reciprocal of the image's speed in rows per line_delay, which is below
# 0.2 up to 5,000 px/s.
_REPETITIONS = 4


@dataclass(frozen=True, eq=False)
class RowMotion:
    """Motion of the camera during one image, at a grid of times from the first row to the last."""

    camera: CameraModel
    """That points are undistorted by."""
    line_delay: float
    """s."""
    times: FloatArray
    """From the middle row's, increasing, (G,), s."""
    turns: FloatArray
    """phi: rotation vectors of middle_R_row, (G, 3), rad."""
    positions: FloatArray | None
    """Of the camera from that at the middle row, in its axes, (G, 3), m; None while not known."""
    focal_ratio: float = 1.0
    """Of the camera's focal length to the one that points are normalised with."""

    @property
    def half(self) -> float:
        """From the middle row to the last, s."""
        return float(self.times[-1])

    def row_times(self, points: FloatArray) -> FloatArray:
        """When points (N, 2) as the image shows them, normalised, are exposed: t, (N,)."""
        rows = self.camera.distort(points).pixels[:, 1]
        rows = np.clip(rows, 0.0, self.camera.height - 1.0)
        return np.asarray(rows * self.line_delay - self.half)

    def derotated(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Points (N, 2) seen at times (N,), turned to the middle row's."""
        return self._turned(points, self._turn(times))

    def rotated(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Points (N, 2) of the middle row's time, turned to times (N,)."""
        return self._turned(points, -self._turn(times))

    def _turned(self, points: FloatArray, vectors: FloatArray) -> FloatArray:
        return self.focal_ratio * _turned(points / self.focal_ratio, vectors)

    def _turn(self, times: FloatArray) -> FloatArray:
        return np.stack([np.interp(times, self.times, phi) for phi in self.turns.T], axis=1)


def _turned(points: FloatArray, vectors: FloatArray) -> FloatArray:
    """Points (N, 2) of rays turned by Exp of rotation vectors (N, 3), by Rodrigues' formula."""
    rays = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = vectors / np.maximum(angle, 1e-12)
    once = np.cross(axis, rays)
    rays = rays + np.sin(angle) * once + (1.0 - np.cos(angle)) * np.cross(axis, once)
    return np.asarray(rays[:, :2] / rays[:, 2:])


@dataclass(frozen=True, eq=False)
class MovingRulings:
    """N rulings at the middle row's time, and how the translation moves them until other rows'.

    At s along a ruling, 0 at its first end and 1 at its second, it moves across itself by

        d(s, t) = (1 - s) (a_0 t + b_0 t^2) + s (a_1 t + b_1 t^2).
    """

    rows: RowMotion
    ends: FloatArray
    """(N, 2, 2), normalised."""
    moves: FloatArray
    """(a, b) of both ends, (N, 2, 2), 1/s and 1/s^2."""

    def part(self, which: NDArray[np.bool_]) -> "MovingRulings":
        """Some of them, by a mask (N,)."""
        return MovingRulings(self.rows, self.ends[which], self.moves[which])

    def bent(self) -> tuple[FloatArray, FloatArray]:
        """Where the image shows them: ends (N, 2, 2), and how far their middle is from between
        these, (N, 2), normalised.
        """
        along = np.tile([0.0, 0.5, 1.0], len(self.ends))
        index = np.repeat(np.arange(len(self.ends)), 3)
        first, second = self.ends[index, 0], self.ends[index, 1]
        points = first + along[:, None] * (second - first)
        normals = normal_of(self.ends)[index]
        times = np.zeros(len(index))
        seen = points
        for _ in range(_REPETITIONS):
            moved = displacements(self.moves[index], along, times)
            seen = self.rows.rotated(points + moved[:, None] * normals, times)
            times = self.rows.row_times(seen)
        seen = seen.reshape(-1, 3, 2)
        return seen[:, ::2], seen[:, 1] - 0.5 * (seen[:, 0] + seen[:, 2])

    def straightened(self, points: FloatArray, index: NDArray[np.int64]) -> "StraightPoints":
        """Points (M, 2) that the image shows along the rulings `index` (M,), moved to the middle
        row's time.
        """
        times = self.rows.row_times(points)
        turned = self.rows.derotated(points, times)
        first = self.ends[index, 0]
        along = self.ends[index, 1] - first
        s = np.sum((turned - first) * along, axis=1) / np.sum(along * along, axis=1)
        normals = normal_of(self.ends)[index]
        moved = displacements(self.moves[index], s, times)
        return StraightPoints(turned - moved[:, None] * normals, s, times)


@dataclass(frozen=True, eq=False)
class StraightPoints:
    """Edge points moved to the middle row's time, (M, 2), and by what that was done."""

    points: FloatArray
    along: FloatArray
    """s, (M,)."""
    times: FloatArray
    """t, (M,), s."""

    def part(self, rows: slice) -> "StraightPoints":
        """Some of them."""
        return StraightPoints(self.points[rows], self.along[rows], self.times[rows])


def displacements(moves: FloatArray, along: FloatArray, times: FloatArray) -> FloatArray:
    """d(s, t) of `MovingRulings`, (M,), of moves (M, 2, 2), s and t (M,)."""
    of_ends = moves[..., 0] * times[:, None] + moves[..., 1] * times[:, None] ** 2
    return np.asarray((1.0 - along) * of_ends[:, 0] + along * of_ends[:, 1])
