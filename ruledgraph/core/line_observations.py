# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What front end and back end tell each other of a line: plain values, joined by its id."""

from collections.abc import Sequence
from typing import NamedTuple

from ruledgraph.core.arrays import FloatArray


class Sighting(NamedTuple):
    """A line's edge in one frame."""

    stamp: int
    points: FloatArray
    """Normalised, (N, 2)."""
    statistics: FloatArray
    """What counts of them, (3, 3), see `GeometricPoints`."""


class LineTrack(NamedTuple):
    """A line as the front end has followed it until now."""

    id: int
    first_time: float
    """Of its first sighting, s."""
    in_view: bool
    """Whether the latest frame saw it."""
    sightings: Sequence[Sighting]
    """In order of time, as far back as they are kept."""


class LinePrediction(NamedTuple):
    """A line as the back end knows it, to predict its next ruling from."""

    plucker: FloatArray
    """World coordinates, (6,)."""
    plucker_by_delta: FloatArray
    """Their derivative by the line's four coordinates, (6, 4)."""
    covariance: FloatArray
    """Of these four, (4, 4)."""
