# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Edge points of one line, made ready for a factor.

Their type chooses the residual:

- `GeometricPoints`: the geometric one, three rows a frame whatever the number of points;
- `ReprojectionPoints`: the paper's reprojection error, two rows a point.

All points are in normalised, undistorted image coordinates, (x, y) = (X/Z, Y/Z).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.ruled_surface import (
    CameraLine,
    Residual,
    geometric_residual,
    reprojection_residual,
)
from ruledgraph_factors.validation import (
    FloatArray,
    IntArray,
    finite_array,
    image_points,
    number,
    positive_number,
)

# Variance of points (normalised image units squared) that is rounding.
_COINCIDENT = 1e-14


@dataclass(frozen=True, eq=False)
class GeometricPoints:
    """The points of n frames as triangular sufficient statistics; build with `from_frames`.

    For any image line l and the points p_i = (x_i, y_i, 1) of a frame,
    |C l|^2 = sum_i w_i (p_i . l)^2: C is the triangular factor of the QR decomposition of the
    stacked sqrt(w_i) p_i. Nothing is lost as long as the loss is quadratic in the points.
    """

    statistics: FloatArray
    """C of each frame, upper triangular, (n, 3, 3)."""

    def __post_init__(self) -> None:
        checked = finite_array("statistics", self.statistics, (None, 3, 3))
        object.__setattr__(self, "statistics", checked)

    @classmethod
    def from_frames(
        cls,
        points: Sequence[ArrayLike],
        weights: Sequence[ArrayLike] | None = None,
        effective_points: float | None = None,
    ) -> "GeometricPoints":
        """Compress the points (N_i, 2), N_i >= 1, of each frame.

        Args:
            points: one array a frame.
            weights: non-negative, one (N_i,) array a frame; by default all 1.
            effective_points: the most information a frame may carry, in points of weight 1.
                Neighbouring edge pixels are not independent: with a deviation of 1 px about 20 is
                realistic. Heavier frames are scaled down to it. By default no cap.

        Raises:
            FactorError: for no frames, a frame without points, NaN, negative or all-zero weights.
        """
        checked = _checked_frames(points, weights, effective_points)
        compress = native.compress if active_kernel() == "native" else compress_in_numpy
        return cls(compress(*checked))

    @property
    def frames(self) -> int:
        """Number of frames, n."""
        return len(self.statistics)

    @property
    def rows(self) -> int:
        """Rows of the residual, 3n: the dimension of the noise model."""
        return 3 * len(self.statistics)

    @cached_property
    def weight(self) -> float:
        """What all points weigh together: their number, if each has weight 1."""
        return float(np.sum(self.statistics[:, :, 2] ** 2))

    @cached_property
    def frame_weights(self) -> FloatArray:
        """What the points of each frame weigh together, (n,)."""
        return np.asarray(np.sum(self.statistics[:, :, 2] ** 2, axis=1))

    @cached_property
    def degrees_of_freedom(self) -> float:
        """Expected squared residual at the truth, over a point's variance: of a frame the weight of
        its points, but at most 2 without their scatter (or of two points).
        """
        weights = self.frame_weights
        flat = ~self.statistics[:, 2].any(axis=1)
        return float(np.sum(np.where(flat, np.minimum(weights, 2.0), weights)))

    def middles(self) -> FloatArray:
        """Mean of the points of each frame, (n, 2)."""
        moments = self.statistics.transpose(0, 2, 1) @ self.statistics[:, :, 2:]
        return np.asarray(moments[:, :2, 0] / moments[:, 2:, 0])

    def image_line(self, frame: int) -> tuple[FloatArray, FloatArray]:
        """Total-least-squares line (a, b, c) of a frame's points, a^2 + b^2 = 1, and their mean.

        Raises:
            FactorError: when they all coincide.
        """
        triangle = self.statistics[frame]
        moments = triangle.T @ triangle
        middle = moments[:2, 2] / moments[2, 2]
        spread, axes = np.linalg.eigh(moments[:2, :2] / moments[2, 2] - np.outer(middle, middle))
        if spread[1] <= _COINCIDENT:
            raise FactorError(f"points[{frame}] all coincide, no line runs through them alone")
        normal = axes[:, 0]
        return np.append(normal, -normal @ middle), middle

    def without_scatter(self) -> "GeometricPoints":
        """The same points but for their scatter across their own best line, which no line explains.

        For an image line l = (n, -rho), |n| = 1, and N points with mean p whose scatter matrix has
        the eigenvalues a >= b, the larger one along e,

            |C l|^2 = N (n.p - rho)^2 + (a - b) (n.e)^2 + b.

        b says nothing of the line. Without it C has two rows and a third of zeros, and the squared
        residual of a frame, over the variance of a point, is chi-square with two degrees of
        freedom, as robust losses and gates take it to be.
        """
        moments = np.einsum("nki,nkj->nij", self.statistics, self.statistics)
        weights = moments[:, 2, 2]
        middles = moments[:, :2, 2] / weights[:, None]
        scatter = moments[:, :2, :2] - weights[:, None, None] * (
            middles[:, :, None] * middles[:, None, :]
        )
        values, axes = np.linalg.eigh(scatter)
        lengths = np.sqrt(np.maximum(values[:, 1] - values[:, 0], 0.0))
        # Triangular again: the long axis turns into the rows of a QR of [mean; axis].
        rows = np.zeros_like(self.statistics)
        rows[:, 0, :2], rows[:, 0, 2] = np.sqrt(weights)[:, None] * middles, np.sqrt(weights)
        rows[:, 1, :2] = lengths[:, None] * axes[:, :, 1]
        return GeometricPoints(np.asarray(np.linalg.qr(rows, mode="r")))

    def with_focal_ratio(self, ratio: float) -> "GeometricPoints":
        """The same points in a camera whose focal length is `ratio` times the one that they were
        normalised with: (x / ratio, y / ratio).

        Raises:
            FactorError: for a ratio that is not positive and finite.
        """
        scale = 1.0 / positive_number("ratio", ratio)
        return GeometricPoints(self.statistics * [scale, scale, 1.0])

    def residual(self, line: CameraLine, focal_ratio: float | None = None) -> Residual:
        """`geometric_residual` of these points."""
        return geometric_residual(line, self.statistics, focal_ratio)


@dataclass(frozen=True, eq=False)
class ReprojectionPoints:
    """The points of n frames one by one; build with `from_frames`."""

    points: FloatArray
    """(N, 2), frame after frame."""
    sqrt_weights: FloatArray
    """(N,)."""
    frame: IntArray
    """Index of each point's frame, from 0 to n - 1 without a gap, (N,)."""

    def __post_init__(self) -> None:
        points = image_points("points", self.points)
        frame = finite_array("frame", self.frame, (len(points),))
        if len(points) == 0 or frame[0] != 0.0 or not np.isin(np.diff(frame), (0, 1)).all():
            raise FactorError("frame must count the frames of the points from 0, in order")
        weights = finite_array("sqrt_weights", self.sqrt_weights, (len(points),))
        if np.any(weights < 0.0):
            raise FactorError("sqrt_weights must not be negative")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "sqrt_weights", weights)
        object.__setattr__(self, "frame", frame.astype(np.int64))

    @classmethod
    def from_frames(
        cls,
        points: Sequence[ArrayLike],
        weights: Sequence[ArrayLike] | None = None,
        effective_points: float | None = None,
    ) -> "ReprojectionPoints":
        """Keep the points of each frame; arguments and errors as `GeometricPoints.from_frames`."""
        stacked, sqrt_weights, counts = _checked_frames(points, weights, effective_points)
        return cls(stacked, sqrt_weights, np.repeat(np.arange(counts.size), counts))

    @property
    def frames(self) -> int:
        """Number of frames, n."""
        return int(self.frame[-1]) + 1

    @property
    def rows(self) -> int:
        """Rows of the residual, 2N: the dimension of the noise model."""
        return 2 * len(self.points)

    @cached_property
    def weight(self) -> float:
        """What all points weigh together: their number, if each has weight 1."""
        return float(self.sqrt_weights @ self.sqrt_weights)

    @cached_property
    def degrees_of_freedom(self) -> float:
        """Expected squared residual at the truth, over a point's variance: `weight`."""
        return self.weight

    def middles(self) -> FloatArray:
        """Mean of the points of each frame, (n, 2)."""
        weights = self.sqrt_weights**2
        totals = np.bincount(self.frame, weights)
        sums = [np.bincount(self.frame, weights * column) for column in self.points.T]
        return np.stack(sums, axis=1) / totals[:, None]

    def residual(self, line: CameraLine, focal_ratio: float | None = None) -> Residual:
        """`reprojection_residual` of these points."""
        arrays = self.points, self.sqrt_weights, self.frame
        return reprojection_residual(line, *arrays, focal_ratio)


def compress_in_numpy(points: FloatArray, sqrt_weights: FloatArray, counts: IntArray) -> FloatArray:
    """Statistics (n, 3, 3) of n frames' points (N, 2), `counts` (n,) of them in each; the reference
    of `_native.compress`.
    """
    rows = np.column_stack([points, np.ones(len(points))]) * sqrt_weights[:, None]
    statistics = np.zeros((counts.size, 3, 3))
    for i, own in enumerate(np.split(rows, np.cumsum(counts)[:-1])):
        triangle = np.linalg.qr(own, mode="r")
        statistics[i, : len(triangle)] = triangle
    return statistics


def _checked_frames(
    points: Sequence[ArrayLike],
    weights: Sequence[ArrayLike] | None,
    effective_points: float | None,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """All frames' points (N, 2), square roots of their weights (N,) and how many a frame has."""
    frames = [np.asarray(p) for p in points]
    if not frames:
        raise FactorError("points is empty: at least one frame with one point is needed")
    try:
        stacked = image_points("points", np.concatenate(frames))
    except (FactorError, ValueError, TypeError):
        for i, p in enumerate(frames):
            image_points(f"points[{i}]", p)
        raise
    counts = np.array([len(frame) for frame in frames])
    for frame in np.flatnonzero(counts == 0):
        raise FactorError(
            f"points[{frame}] is empty: leave out a frame that saw nothing (motion.select)"
        )
    if weights is None:
        weight, total = np.ones(len(stacked)), counts.astype(np.float64)
    else:
        weight, total = _checked_weights(weights, counts)
    if effective_points is not None:
        cap = positive_number("effective_points", effective_points)
        weight = weight * np.repeat(np.minimum(1.0, cap / total), counts)
    return stacked, np.sqrt(weight), counts


def _checked_weights(
    weights: Sequence[ArrayLike], counts: IntArray
) -> tuple[FloatArray, FloatArray]:
    """All frames' weights (N,) and the sum of each frame's (n,)."""
    if len(weights) != counts.size:
        raise FactorError(f"weights has {len(weights)} frames, but points has {counts.size}")
    checked = [
        finite_array(f"weights[{i}]", w, (count,))
        for i, (w, count) in enumerate(zip(weights, counts.tolist(), strict=True))
    ]
    for i, weight in enumerate(checked):
        if np.any(weight < 0.0) or not np.any(weight > 0.0):
            raise FactorError(f"weights[{i}] must be non-negative and not all zero")
    return np.concatenate(checked), np.array([weight.sum() for weight in checked])


def bin_points(
    times: ArrayLike, points: ArrayLike, bin_width: float
) -> tuple[FloatArray, list[FloatArray]]:
    """Bin points that each have a time of their own (event camera, rolling shutter).

    Args:
        times: of the points, in any order, (N,), s.
        points: (N, 2).
        bin_width: longest stretch of time that shares one pose, s; 0 gives every distinct time a
            bin of its own. A point is off by its distance in time from the bin's mean, at most
            the bin's width, times its image speed: keep that well below its noise.

    Returns:
        The times of the bins, each the mean of its points', strictly increasing, (n,), and the
        points of each, [(N_i, 2)]: `frame_times` of `preintegrate_frames` and `points` of
        `from_frames`.
    """
    stamps = finite_array("times", times, (None,))
    xy = image_points("points", finite_array("points", points, (stamps.size, 2)))
    if stamps.size == 0:
        raise FactorError("times is empty")
    if number("bin_width", bin_width) < 0.0:
        raise FactorError(f"bin_width must not be negative, got {bin_width:g}")
    bins = np.floor((stamps - stamps.min()) / bin_width) if bin_width > 0.0 else stamps
    labels, index = np.unique(bins, return_inverse=True)
    counts = np.bincount(index, minlength=labels.size)
    offsets = np.bincount(index, weights=stamps - stamps.min(), minlength=labels.size) / counts
    order = np.argsort(index, kind="stable")
    return stamps.min() + offsets, np.split(xy[order], np.cumsum(counts)[:-1])
