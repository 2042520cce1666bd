# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Repeated sightings of one physical line become one line of the map.

A line that leaves the view and returns is another variable of the graph, so that the map holds it
twice. The chart for two lines is that of two planes across one of them, at stations s1 and s2 along
it: a line is the two points, (4,), m, in which it crosses them. It is linear in the ends of nearly
parallel lines, and the lines' 4-DoF covariances are carried into it to first order. A and B are the
same line when all of this holds:

- their difference passes the chi-square test, (a - b)^T (A + B)^-1 (a - b) <= chi2(4 DoF);
- they overlap along the line, or touch;
- they were not seen beside each other at one time: those are two edges, of a board for instance;
- another line would have been told apart: the ellipse across the line, in which B is accepted, is
  smaller than what a line of the scene has for itself, spacing^2. Without this a line of which
  little is known is the same as any other.

The merged line is the information-weighted mean in the chart, as long as both together.

Covariances are those in the world of a trajectory segment, which contain its drift up to the
sighting, and so its growth from the first sighting to the second. What is common to both counts
twice: the test errs towards acceptance, and the ellipse grows with the drift, so that lines
are merged while position and yaw are known better than the lines' spacing. Lines of
different segments stay apart, as the gap between these is in no line's covariance.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import MapConfig
from ruledgraph.core.estimates import LineEstimate

# The chart serves lines whose angle has at least this cosine (18 degrees).
_PARALLEL = 0.95
# Keeps covariances of known lines regular, m^2: a micrometre's.
_ROUNDING = 1e-12


def merged_lines(lines: Sequence[LineEstimate], config: MapConfig) -> list[LineEstimate]:
    """The map of lines that left the window: each physical line once, as far as can be told.

    The best known lines come first. A merged line has the id of its first sighting; lines
    without covariance stay as they are. The result is in order of the first sightings.
    """
    merging = _Merging(lines, config)
    for index in merging.order():
        merging.place(index)
    return sorted(merging.lines(), key=lambda line: (line.first_stamp, line.id))


class _Chart(NamedTuple):
    """Two planes across a line: where others cross them."""

    origin: FloatArray
    """On the line, (3,), m."""
    along: FloatArray
    """Unit direction, (3,)."""
    across: FloatArray
    """Two unit vectors, (2, 3)."""

    @classmethod
    def of(cls, ends: FloatArray) -> "_Chart":
        """Around the line through two ends, (2, 3)."""
        step = ends[1] - ends[0]
        along = step / np.linalg.norm(step)
        first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        first /= np.linalg.norm(first)
        return cls(ends[0], along, np.stack([first, np.cross(along, first)]))

    def stations(self, ends: FloatArray) -> FloatArray:
        """How far along points (..., 3) lie, m."""
        return np.asarray((ends - self.origin) @ self.along)

    def crossings(
        self, ends: FloatArray, covariance: FloatArray, stations: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Coordinates (K, 4), m, of K lines at their stations (K, 2), and covariances (K, 4, 4).

        With the step d from end e1 to e2 a line crosses a plane at e1 + share d; an end that moves
        by x moves the crossing by its weight times (I - d along^T / along^T d) x.
        """
        step = ends[:, 1] - ends[:, 0]
        length = (step @ self.along)[:, None]
        share = (stations - self.stations(ends[:, :1])) / length
        points = ends[:, None, 0] + share[..., None] * step[:, None] - self.origin
        slope = (step @ self.across.T) / length
        by_end = self.across - slope[..., None] * self.along
        weights = np.stack([1.0 - share, share], axis=-1)
        jacobian = np.einsum("kse,kax->ksaex", weights, by_end).reshape(-1, 4, 6)
        coordinates = (points @ self.across.T).reshape(-1, 4)
        return coordinates, jacobian @ covariance @ jacobian.transpose(0, 2, 1)

    def line(
        self, coordinates: FloatArray, covariance: FloatArray, stations: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Ends (2, 3) of the line with these coordinates, and their covariance (6, 6)."""
        ends = (
            self.origin + stations[:, None] * self.along + coordinates.reshape(2, 2) @ self.across
        )
        jacobian = np.kron(np.eye(2), self.across.T)
        return ends, jacobian @ covariance @ jacobian.T


class _Merging:
    """Places lines in the map one by one."""

    def __init__(self, lines: Sequence[LineEstimate], config: MapConfig) -> None:
        self._lines = list(lines)
        self._config = config
        self._ends = np.array([line.ends for line in lines]).reshape(-1, 2, 3)
        self._covariance = np.array([line.joint_covariance for line in lines]).reshape(-1, 6, 6)
        self._segment = np.array([line.segment for line in lines])
        stamps = [(line.first_stamp, line.last_stamp) for line in lines]
        self._views = self._ends.copy(), np.array(stamps, dtype=np.int64).reshape(-1, 2)
        self._members = [[index] for index in range(len(lines))]
        self._in_map = np.zeros(len(lines), dtype=bool)
        self._left = np.ones(len(lines), dtype=bool)
        self._max_chi2 = float(chdtri(4, 1.0 - config.confidence))
        # Of the ellipse pi k^2 sqrt(det S) that holds `confidence` of two coordinates' Gaussian.
        k2 = -2.0 * math.log(1.0 - config.confidence)
        self._max_det = (config.spacing**2 / (math.pi * k2)) ** 2

    def lines(self) -> list[LineEstimate]:
        """The map."""
        return [self._lines[index] for index in np.flatnonzero(self._left)]

    def order(self) -> list[int]:
        """Lines that can be told from others, the best known first."""
        known = [(self._own_det(index), index) for index in range(len(self._lines))]
        return [index for det, index in sorted(known) if det < self._max_det]

    def _own_det(self, index: int) -> float:
        ends, covariance = self._ends[index], self._covariance[index]
        length = np.linalg.norm(ends[1] - ends[0])
        if not (length > 0.0 and np.isfinite(covariance).all()):
            return math.inf
        chart = _Chart.of(ends)
        own = chart.crossings(ends[None], covariance[None], np.array([[0.0, length]]))
        return float(_mid_det(own[1])[0])

    def place(self, index: int) -> None:
        """Add a line to the map, with all that are the same."""
        while (other := self._same(index)) is not None:
            self._merge(index, other)
        self._in_map[index] = True

    def _same(self, index: int) -> int | None:
        """The line of the map that is the same, the likeliest of several."""
        chart = _Chart.of(self._ends[index])
        others = np.flatnonzero(self._in_map & (self._segment == self._segment[index]))
        steps = self._ends[others, 1] - self._ends[others, 0]
        cosine = np.abs(steps @ chart.along)
        others = others[cosine >= _PARALLEL * np.sqrt(np.sum(steps * steps, axis=1))]
        own, reach = chart.stations(self._ends[index]), chart.stations(self._ends[others])
        low = np.maximum(own.min(), reach.min(axis=1, initial=np.inf))
        high = np.minimum(own.max(), reach.max(axis=1, initial=-np.inf))
        touch = low - high <= self._config.extent_tolerance
        others, reach, middle = others[touch], reach[touch], 0.5 * (low + high)[touch]
        half = 0.5 * np.minimum(np.ptp(own), np.ptp(reach, axis=1))
        stations = np.stack([middle - half, middle + half], axis=1)
        a, A = chart.crossings(self._ends[None, index], self._covariance[None, index], stations)
        b, B = chart.crossings(self._ends[others], self._covariance[others], stations)
        S = A + B + _ROUNDING * np.eye(4)
        chi2 = np.sum((a - b) * np.linalg.solve(S, (a - b)[..., None])[..., 0], axis=1)
        passed = np.flatnonzero((chi2 <= self._max_chi2) & (_mid_det(S) <= self._max_det))
        for which in passed[np.argsort(chi2[passed], kind="stable")]:
            if not self._are_beside(chart, index, int(others[which])):
                return int(others[which])
        return None

    def _are_beside(self, chart: _Chart, index: int, other: int) -> bool:
        """Whether some of their sightings were at one time, one beside the other."""
        ends, stamps = self._views
        one, two = self._members[index], self._members[other]
        at_once = _overlaps(stamps[one], stamps[two]) > 0
        along = _overlaps(
            np.sort(chart.stations(ends[one]), axis=1), np.sort(chart.stations(ends[two]), axis=1)
        )
        return bool((at_once & (along > self._config.extent_tolerance)).any())

    def _merge(self, index: int, other: int) -> None:
        """Put a line of the map into another one, which is as long as both then."""
        chart, pair = _Chart.of(self._ends[index]), [index, other]
        reach = chart.stations(self._ends[pair])
        stations = np.array([reach.min(), reach.max()])
        (a, b), (A, B) = chart.crossings(
            self._ends[pair], self._covariance[pair], np.stack([stations, stations])
        )
        gain = A @ np.linalg.inv(A + B + _ROUNDING * np.eye(4))
        mean = chart.line(a + gain @ (b - a), A - gain @ A, stations)
        self._ends[index], self._covariance[index] = mean
        self._members[index] += self._members[other]
        self._in_map[other] = self._left[other] = False
        one, two = self._lines[index], self._lines[other]
        first = min(one, two, key=lambda line: (line.first_stamp, line.id))
        self._lines[index] = replace(
            first,
            ends=mean[0],
            joint_covariance=mean[1],
            last_stamp=max(one.last_stamp, two.last_stamp),
            points=one.points + two.points,
            sightings=one.sightings + two.sightings,
        )


def _mid_det(covariance: FloatArray) -> FloatArray:
    """Determinants, (K,), m^4, of covariances (K, 4, 4) midway between the stations."""
    half = np.array([[0.5, 0.0, 0.5, 0.0], [0.0, 0.5, 0.0, 0.5]])
    return np.asarray(np.linalg.det(half @ covariance @ half.T))


def _overlaps(one: NDArray[Any], two: NDArray[Any]) -> NDArray[Any]:
    """Lengths, (M, N), negative for gaps, that intervals (M, 2) and (N, 2) have in common."""
    stop = np.minimum(one[:, None, 1], two[None, :, 1])
    return np.asarray(stop - np.maximum(one[:, None, 0], two[None, :, 0]))
