# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the graph: their estimates and the extents over which they were seen."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import LineEstimate
from ruledgraph.core.line_observations import LinePrediction
from ruledgraph_factors import FactorError, LineChart
from ruledgraph_factors.so3 import hat

# World coordinates (6,) and their derivative (6, 4).
Plucker: TypeAlias = tuple[FloatArray, FloatArray]

# How many of the latest sightings of a line's ends are kept, to bound the memory.
_KEPT = 200
# A direction shorter than this, of a unit Plucker pair, belongs to a line at infinity.
_INFINITE = 1e-9
# A ray is parallel to a line below this, the sine of their angle squared.
_PARALLEL = 1e-4


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
    points: int = 0
    bad_states: int = 0
    covariance_time: float = -np.inf
    _extents: list[FloatArray] = field(default_factory=list)
    _cached_plucker: tuple[FloatArray, LineChart, Plucker] | None = None

    @property
    def plucker(self) -> Plucker:
        """`LineChart.plucker` of `delta`, computed anew when that is replaced, not every frame."""
        cached = self._cached_plucker
        if cached is None or cached[0] is not self.delta or cached[1] is not self.chart:
            cached = self._cached_plucker = self.delta, self.chart, self.chart.plucker(self.delta)
        return cached[2]

    def prediction(self) -> LinePrediction:
        """What the front end needs to predict its ruling."""
        return LinePrediction(*self.plucker, self.covariance)

    def inverse_distance(self) -> tuple[float, float]:
        """One over the distance from the anchor and its standard deviation, 1/m."""
        inverse, slope = self.chart.inverse_distance(self.delta)
        return inverse, float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))

    def record_extent(self, extent: FloatArray) -> None:
        """Add where it was seen from and to, (2,), m from the point closest to the anchor."""
        self._extents.append(extent)
        del self._extents[:-_KEPT]

    def estimate(self, outliers: float) -> LineEstimate | None:
        """End points as far as the line was seen, but for a share of `outliers`; None without a
        finite line.
        """
        if not self._extents:
            return None
        extent = np.diagonal(np.quantile(self._extents, [outliers, 1.0 - outliers], axis=0))
        try:
            ends, jacobian = self.chart.end_points(self.delta, extent)
        except FactorError:
            return None
        covariance = jacobian @ self.covariance @ jacobian.transpose(0, 2, 1)
        return LineEstimate(
            self.id, ends, covariance, self.first_stamp, self.last_stamp, self.points
        )


def record_extent(
    lines: Sequence[Landmark], world_T_cams: Sequence[gtsam.Pose3], ends: FloatArray
) -> None:
    """Record the extents over which lines were seen, each by its camera from end to end.

    The extent of an end is s where the line, foot + s unit, is closest to the ray through it;
    (N, 2) for ends (N, 2, 2), normalised.
    """
    if not lines:
        return
    plucker = np.array([line.plucker[0] for line in lines])
    moment, direction = plucker[:, :3], plucker[:, 3:]
    length = np.sqrt(np.sum(direction * direction, axis=1, keepdims=True))
    finite = length >= _INFINITE
    length = np.where(finite, length, 1.0)
    unit = direction / length
    foot = (hat(unit) @ moment[..., None])[..., 0] / length
    # Counted from the point next to the anchor, as by `LineChart.end_points`.
    anchors = np.array([line.chart.world_T_anchor.translation() for line in lines])
    foot += unit * np.sum(unit * (anchors - foot), axis=1, keepdims=True)
    rays = np.ones((len(lines), 2, 3))
    rays[..., :2] = ends
    rotations = np.array([camera.rotation().matrix() for camera in world_T_cams])
    rays = rays @ rotations.transpose(0, 2, 1)
    rays /= np.sqrt(np.sum(rays * rays, axis=2, keepdims=True))
    cosine = (rays @ unit[..., None])[..., 0]
    sine2 = 1.0 - cosine * cosine
    seen = finite & (sine2 >= _PARALLEL)
    offset = np.array([camera.translation() for camera in world_T_cams]) - foot
    along = np.sum(unit * offset, axis=1, keepdims=True)
    reach = along - cosine * (rays @ offset[..., None])[..., 0]
    reach = np.sort(reach / np.where(seen, sine2, 1.0), axis=1)
    for line, own, both in zip(lines, reach, seen.all(axis=1).tolist(), strict=True):
        if both:
            line.record_extent(own)
