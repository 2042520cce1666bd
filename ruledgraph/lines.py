# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the graph: where they appear next, how far they reach, when they are no good."""

from dataclasses import dataclass, field

import gtsam
import numpy as np

from ruledgraph.edges.search import Ruling
from ruledgraph.sensors import FloatArray
from ruledgraph.tracks import Track
from ruledgraph_factors import FactorError, LineChart

# Deviation of a predicted ruling that the motion's uncertainty leaves, px, and the most.
_MOTION_SIGMA, _MOST_SIGMA = 1.2, 8.0
# Below this depth a point is too close to the camera to be told from one behind it, m.
_NEAREST = 0.05
# Share of a line's sightings whose ends may lie beyond the reported ones, and how many are kept.
_STRAY, _KEPT = 0.1, 200


@dataclass(frozen=True, eq=False)
class LineEstimate:
    """A line as it left the window."""

    number: int
    ends: FloatArray
    """In the world, (2, 3), m."""
    covariance: FloatArray
    """Of each end, (2, 3, 3), m^2."""
    first_stamp: int
    last_stamp: int
    points: int
    """Edge points that went into it."""


@dataclass(eq=False)
class GraphLine:
    """A line variable of the graph."""

    key: int
    track: Track
    chart: LineChart
    delta: FloatArray
    covariance: FloatArray
    """Marginal, of `delta`, (4, 4), as of `covariance_time`."""
    first_stamp: int
    last_stamp: int
    last_time: float
    """Of the last knot whose interval saw it, s."""
    points: int = 0
    bad_knots: int = 0
    covariance_time: float = -np.inf
    _reach: list[FloatArray] = field(default_factory=list)

    def inverse_distance(self) -> tuple[float, float]:
        """One over the distance from the anchor and its standard deviation, 1/m."""
        inverse, slope = self.chart.inverse_distance(self.delta)
        return inverse, float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))

    def extend(self, world_T_cam: gtsam.Pose3, points: FloatArray) -> None:
        """Take note of how far the line was seen, points (N, 2) being in order along it."""
        try:
            foot, _ = self.chart.closest_point(self.delta)
        except FactorError:
            return  # at infinity
        direction, _ = self.chart.direction(self.delta)
        rotation, centre = world_T_cam.rotation().matrix(), world_T_cam.translation()
        reach: list[float] = []
        for point in points[[0, -1]]:
            along = _closest_to_ray(foot, direction, centre, rotation @ np.append(point, 1.0))
            if along is None:
                return
            reach.append(along)
        self._reach.append(np.sort(np.array(reach)))
        del self._reach[:-_KEPT]

    def estimate(self) -> LineEstimate | None:
        """End points as far as the line was seen; None without a finite line."""
        if not self._reach:
            return None
        reach = np.array(self._reach)
        extent = [np.quantile(reach[:, 0], _STRAY), np.quantile(reach[:, 1], 1.0 - _STRAY)]
        try:
            ends, jacobian = self.chart.end_points(self.delta, extent)
        except FactorError:
            return None
        covariance = jacobian @ self.covariance @ jacobian.transpose(0, 2, 1)
        return LineEstimate(
            self.track.number, ends, covariance, self.first_stamp, self.last_stamp, self.points
        )

    def ruling(
        self,
        world_T_before: gtsam.Pose3,
        world_T_cam: gtsam.Pose3,
        by_rotation: Ruling,
        focal: float,
    ) -> Ruling:
        """Where the line appears: m_c = R^T (m - p x v), with the spread its covariance gives.

        Args:
            world_T_before: camera pose at the track's last frame.
            world_T_cam: camera pose now.
            by_rotation: the track's prediction without the line's depth, for ends that the line
                does not fix.
            focal: focal length, px.
        """
        plucker, by_delta = self.chart.plucker(self.delta)
        moment, direction = plucker[:3], plucker[3:]
        R, p = world_T_cam.rotation().matrix(), world_T_cam.translation()
        m = R.T @ (moment - np.cross(p, direction))
        size = float(np.hypot(m[0], m[1]))
        if size < 1e-9:
            return by_rotation
        ends = by_rotation.ends.copy()
        length = float(np.linalg.norm(direction))
        if length > 1e-6:
            unit = direction / length
            foot = np.cross(unit, moment / length)
            R_before, before = world_T_before.rotation().matrix(), world_T_before.translation()
            for i, end in enumerate(self.track.ends):
                ray = R_before @ np.append(end, 1.0)
                along = _closest_to_ray(foot, unit, before, ray)
                if along is not None:
                    in_cam = R.T @ (foot + along * unit - p)
                    if in_cam[2] > _NEAREST:
                        ends[i] = in_cam[:2] / in_cam[2]
        # Onto the ruling.
        ends -= (ends @ m[:2] + m[2])[:, None] * m[:2] / size**2
        by_m = R.T @ (by_delta[:3] - np.cross(p, by_delta[3:], axis=0))
        gradient = np.column_stack([ends, np.ones(2)]) @ by_m / size
        variance = np.einsum("ei,ij,ej->e", gradient, self.covariance, gradient)
        floor = _MOTION_SIGMA * 1.5**self.track.misses
        sigmas = np.minimum(
            np.hypot(focal * np.sqrt(np.maximum(variance, 0.0)), floor), _MOST_SIGMA
        )
        return Ruling(ends, (float(sigmas[0]), float(sigmas[1])), self.track.slope)


def _closest_to_ray(
    foot: FloatArray, direction: FloatArray, centre: FloatArray, ray: FloatArray
) -> float | None:
    """Place s of the point foot + s direction closest to a ray, None where they are parallel."""
    ray = ray / np.linalg.norm(ray)
    cosine = float(ray @ direction)
    if 1.0 - cosine * cosine < 1e-4:
        return None
    offset = centre - foot
    return float(direction @ offset - cosine * (ray @ offset)) / (1.0 - cosine * cosine)
