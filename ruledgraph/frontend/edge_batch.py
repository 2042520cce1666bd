# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""All lines of a frame at once: rulings and what is found along them, in arrays, a row each."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, EdgesConfig
from ruledgraph.frontend import kernel
from ruledgraph.frontend.edge_search import EdgePoints, Ruling, search
from ruledgraph.frontend.gradient import BORDER_PX, Gradient
from ruledgraph_factors import GeometricPoints

SEARCH_SETTINGS = (
    "station_distance_px",
    "max_stations",
    "min_points",
    "min_support",
    "min_extent",
    "min_slope",
    "min_slope_share",
    "stripe_px",
    "stripe_share",
    "vote_px",
    "inlier_px",
    "sigma_penalty",
    "rival_distance_px",
    "rival_share",
    "end_growth",
)
"""Those of `EdgesConfig` that the native search takes."""
# A segment that extends less than this along an axis runs along the other one; a smaller share of
# one in view is none.
_LEVEL, _MIN_PART = 1e-12, 1e-6


class Rulings(NamedTuple):
    """N of `Ruling`."""

    ends: FloatArray
    """(N, 2, 2), normalised."""
    sigmas: FloatArray
    """(N, 2), px."""
    slopes: FloatArray
    """(N,)."""
    bows: FloatArray | None = None
    """(N, 2), where they are bent."""

    def part(self, rows: NDArray[np.bool_] | Sequence[int]) -> "Rulings":
        """Some of them."""
        bows = None if self.bows is None else self.bows[rows]
        return Rulings(self.ends[rows], self.sigmas[rows], self.slopes[rows], bows)

    def one_by_one(self) -> list[Ruling]:
        """As `search` takes them."""
        bows = [None] * len(self.ends) if self.bows is None else list(self.bows)
        return [
            Ruling(ends, (first, second), slope, bow)
            for ends, (first, second), slope, bow in zip(
                self.ends, self.sigmas.tolist(), self.slopes.tolist(), bows, strict=True
            )
        ]


class Edges(NamedTuple):
    """What counts of N `EdgePoints`."""

    counts: NDArray[np.int64]
    """How many points each has, (N,); 0: there is no such line, and its row has no meaning."""
    points: FloatArray
    """One line's after the other's, (M, 2)."""
    ends: FloatArray
    """Those of the rulings, moved by `moved_ends`, (N, 2, 2)."""
    statistics: FloatArray
    """All that counts of the points, (N, 3, 3), see `GeometricPoints`."""
    lines: FloatArray
    """(N, 2), px."""
    support: FloatArray
    rms_px: FloatArray
    slopes: FloatArray
    ambiguous: NDArray[np.bool_]

    def part(self, rows: NDArray[np.bool_]) -> "Edges":
        """Those of a mask, (N,)."""
        return Edges(
            counts=self.counts[rows],
            points=self.points[np.repeat(rows, self.counts)],
            ends=self.ends[rows],
            statistics=self.statistics[rows],
            lines=self.lines[rows],
            support=self.support[rows],
            rms_px=self.rms_px[rows],
            slopes=self.slopes[rows],
            ambiguous=self.ambiguous[rows],
        )

    def points_of_each(self) -> list[FloatArray]:
        """Views, N of (N_i, 2)."""
        ends = np.cumsum(self.counts)
        starts = (ends - self.counts).tolist()
        return [self.points[a:b] for a, b in zip(starts, ends.tolist(), strict=True)]


def moved_ends(ends: FloatArray, points: FloatArray, growth: float) -> FloatArray:
    """A segment's ends (2, 2) moved onto the line through points (N, 2), which come in order along
    it, and a share `growth` of the way towards the outermost ones.
    """
    middle = points.mean(axis=0)
    off = points - middle
    xx, xy, yy = off[:, 0] @ off[:, 0], off[:, 0] @ off[:, 1], off[:, 1] @ off[:, 1]
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    direction = np.array([np.cos(angle), np.sin(angle)])
    if direction @ (ends[1] - ends[0]) < 0.0:
        direction = -direction
    predicted, places = (ends - middle) @ direction, off @ direction
    # One stray point does not stretch it: a station beyond the second and the last but one.
    station = max(float(np.min(np.diff(places))), 0.0)
    outermost = places[[1, -2]] + np.array([-station, station])
    along = predicted + growth * (outermost - predicted)
    return np.asarray(middle + along[:, None] * direction)


def stacked(
    rulings: Rulings,
    found: Sequence[EdgePoints | None],
    config: EdgesConfig = DEFAULTS.edges,
) -> Edges:
    """What was found along rulings one by one."""
    n = len(found)
    edges = Edges(
        counts=np.zeros(n, np.int64),
        points=np.concatenate([np.zeros((0, 2)), *(e.points for e in found if e is not None)]),
        ends=np.zeros((n, 2, 2)),
        statistics=np.zeros((n, 3, 3)),
        lines=np.zeros((n, 2)),
        support=np.zeros(n),
        rms_px=np.zeros(n),
        slopes=np.zeros(n),
        ambiguous=np.zeros(n, np.bool_),
    )
    for i, edge in enumerate(found):
        if edge is not None:
            edges.counts[i], edges.lines[i] = len(edge.points), edge.line
            edges.ends[i] = moved_ends(rulings.ends[i], edge.points, config.end_growth)
            edges.statistics[i] = GeometricPoints.from_frames([edge.points]).statistics[0]
            edges.support[i], edges.rms_px[i] = edge.support, edge.rms_px
            edges.slopes[i], edges.ambiguous[i] = edge.slope, edge.ambiguous
    return edges


def search_all(
    gradient: Gradient,
    camera: CameraModel,
    rulings: Rulings,
    beyond: float = 0.0,
    config: EdgesConfig = DEFAULTS.edges,
) -> Edges:
    """`search` of every ruling, by the native kernel if there is one.

    Raises:
        FactorError: when the environment asks for a kernel that there is not.
    """
    if not kernel.is_native():
        found = [search(gradient, camera, each, beyond, config) for each in rulings.one_by_one()]
        return stacked(rulings, found, config)
    known = _native_camera(camera), _native_settings(config)
    ends, sigmas, slopes, bows = rulings
    columns = kernel.native.search_all(gradient.xy, *known, ends, sigmas, slopes, beyond, bows)
    edges = Edges(*columns)
    return edges._replace(
        ends=edges.ends.reshape(-1, 2, 2), statistics=edges.statistics.reshape(-1, 3, 3)
    )


@lru_cache(maxsize=8)
def _native_camera(camera: CameraModel) -> "kernel.native.Camera":
    return kernel.native.Camera(**vars(camera))


@lru_cache(maxsize=8)
def _native_settings(config: EdgesConfig) -> "kernel.native.SearchSettings":
    of_search = {name: getattr(config, name) for name in SEARCH_SETTINGS}
    return kernel.native.SearchSettings(**of_search, border_px=BORDER_PX)


def clipped(
    ends: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The parts of segments (N, 2, 2) inside a field of view from `low` (2,) to `high` (2,), and
    which of them have one, (N,); the others stay as they are.
    """
    clip = kernel.native.clip_all if kernel.is_native() else clip_in_numpy
    parts, visible = clip(ends, low, high)
    return parts.reshape(-1, 2, 2), visible


def clip_in_numpy(
    ends: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The reference of `_native_frame.clip_all`."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    level = np.abs(along) < _LEVEL
    between = (start >= low) & (start <= high)
    safe = np.where(level, 1.0, along)
    a, b = (low - start) / safe, (high - start) / safe
    # A segment along an axis is inside all the way or not at all.
    enter = np.where(level, np.where(between, 0.0, np.inf), np.minimum(a, b))
    leave = np.where(level, 1.0, np.maximum(a, b))
    first, last = enter.max(axis=1).clip(min=0.0), leave.min(axis=1).clip(max=1.0)
    visible = last - first > _MIN_PART
    parts = np.stack([start + first[:, None] * along, start + last[:, None] * along], axis=1)
    return np.where(visible[:, None, None], parts, ends), visible
