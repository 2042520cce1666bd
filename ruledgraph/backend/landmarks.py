# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the graph: their estimates and the extents over which they were seen."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import gtsam
import numpy as np

from ruledgraph.backend.line_distance import InverseDistance
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import LineEstimate
from ruledgraph.core.line_geometry import closest_to_rays
from ruledgraph.core.line_observations import PluckerEstimate
from ruledgraph_factors import FactorError, LineChart

# World coordinates (6,) and their derivative (6, 4).
Plucker: TypeAlias = tuple[FloatArray, FloatArray]

# How many of the latest sightings of a line's ends are kept, to bound the memory.
_KEPT = 200
# A direction shorter than this, of a unit Plucker pair, belongs to a line at infinity.
_INFINITE = 1e-9


@dataclass(eq=False)
class Landmark:
    """A line variable of the graph."""

    id: int
    """The track's."""
    key: int
    chart: LineChart
    delta: FloatArray
    covariance: FloatArray
    """Marginal, of `delta`, (4, 4), as of `covariance_time`."""
    first_stamp: int
    last_stamp: int
    last_time: float
    """Of the last state whose interval saw it, s."""
    in_view: bool = True
    """Whether the latest frame saw it."""
    linearized: FloatArray = field(default_factory=lambda: np.zeros(4))
    """The delta at which the smoother holds its factors linearised."""
    linearization_frozen: bool = False
    """Whether a neighbour was marginalised, so that the smoother no longer relinearises it."""
    weight: float = 1.0
    """Of its points, see `line_weights`."""
    points: int = 0
    bad_states: int = 0
    covariance_time: float = -np.inf
    _views: list[FloatArray] = field(default_factory=list)
    _cached_plucker: tuple[FloatArray, LineChart, Plucker] | None = None

    @property
    def plucker(self) -> Plucker:
        """`LineChart.plucker` of `delta`, computed anew when that is replaced, not every frame."""
        cached = self._cached_plucker
        if cached is None or cached[0] is not self.delta or cached[1] is not self.chart:
            cached = self._cached_plucker = self.delta, self.chart, self.chart.plucker(self.delta)
        return cached[2]

    def prediction(self) -> PluckerEstimate:
        """What the front end needs to predict its ruling."""
        return PluckerEstimate(*self.plucker, self.covariance)

    def inverse_distance(self) -> InverseDistance:
        """One over the distance from the anchor, 1/m."""
        return InverseDistance.of(self.chart, self.delta, self.covariance)

    def record_view(self, view: FloatArray) -> None:
        """The camera's centre and the rays to both ends of what it saw, (3, 3), in the world."""
        self._views.append(view)
        del self._views[:-_KEPT]

    def estimate(self, outliers: float) -> LineEstimate | None:
        """End points as far as the line was seen, but for a share of `outliers`; None without a
        finite line.
        """
        extents = self._extents()
        if not len(extents):
            return None
        extent = np.diagonal(np.quantile(extents, [outliers, 1.0 - outliers], axis=0))
        try:
            ends, jacobian = self.chart.end_points(self.delta, extent)
        except FactorError:
            return None
        by_delta = jacobian.reshape(6, 4)
        covariance = by_delta @ self.covariance @ by_delta.T
        return LineEstimate(
            self.id, ends, covariance, self.first_stamp, self.last_stamp, self.points
        )

    def _extents(self) -> FloatArray:
        """From where to where it was seen, (N, 2), m from the point next to the anchor.

        The reach of an end is s where the line, foot + s unit, is closest to the ray through it.
        The line is the present one: at first its distance is a guess, and so would be its length.
        """
        moment, direction = np.split(self.plucker[0], 2)
        length = float(np.linalg.norm(direction))
        if not self._views or length < _INFINITE:
            return np.empty((0, 2))
        unit = direction / length
        foot = np.cross(unit, moment) / length
        # Counted from the point next to the anchor, as by `LineChart.end_points`.
        foot += unit * (unit @ (self.chart.world_T_anchor.translation() - foot))
        views = np.array(self._views)
        reach = closest_to_rays(foot, unit, views[:, 0], views[:, 1:])
        return np.sort(reach[np.isfinite(reach).all(axis=1)], axis=1)


def record_extent(
    lines: Sequence[Landmark], world_T_cams: Sequence[gtsam.Pose3], ends: FloatArray
) -> None:
    """Record where lines end, each as its camera sees it: ends (N, 2, 2), normalised."""
    if not lines:
        return
    rays = np.concatenate([ends, np.ones((len(lines), 2, 1))], axis=2)
    rays = rays @ np.array([camera.rotation().matrix().T for camera in world_T_cams])
    centres = np.array([camera.translation() for camera in world_T_cams])
    for line, view in zip(lines, np.concatenate([centres[:, None], rays], axis=1), strict=True):
        line.record_view(view)
