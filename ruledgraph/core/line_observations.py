# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What front end and back end exchange about a line: plain values, joined by its id."""

from collections.abc import Sequence
from typing import NamedTuple

from ruledgraph.core.arrays import FloatArray


class Sighting(NamedTuple):
    """A line's edge in one frame."""

    stamp: int
    points: FloatArray
    """Normalised, (N, 2)."""
    statistics: FloatArray
    """The points compressed for the factor: upper triangular C, (3, 3), with |C l|^2 the weighted
    sum of their squared distances from any image line l (see `GeometricPoints`), scaled down to
    `edges.effective_points` and without their scatter across their own best line."""

    def with_focal_ratio(self, ratio: float) -> "Sighting":
        """The same in a camera whose focal length is `ratio` times the one that points were
        normalised with.
        """
        statistics = self.statistics / [ratio, ratio, 1.0]
        return Sighting(self.stamp, self.points / ratio, statistics)


class LineTrack(NamedTuple):
    """The track of a line in the front end, up to the latest frame."""

    id: int
    first_time: float
    """Of its first sighting, s."""
    in_view: bool
    """Whether the latest frame saw it."""
    sightings: Sequence[Sighting]
    """In order of time, as far back as they are kept."""


class PluckerEstimate(NamedTuple):
    """The back end's estimate of a line, to predict its next ruling from."""

    plucker: FloatArray
    """World coordinates, (6,)."""
    plucker_by_delta: FloatArray
    """Their derivative by the line's four coordinates, (6, 4)."""
    covariance: FloatArray
    """Of these four, (4, 4)."""
