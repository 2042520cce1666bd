# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A line that is followed through the images."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, TracksConfig
from ruledgraph.core.line_observations import Sighting
from ruledgraph.frontend.row_motion import StraightPoints


class Unsettled(NamedTuple):
    """A rolling shutter's last sighting of a line whose motion at that time the next one tells."""

    points: StraightPoints
    normal: FloatArray
    """Of the ruling, (2,)."""
    moves: FloatArray
    """By which the points were moved, (2, 2), see `MovingRulings`."""
    first: bool
    """Whether the moves were a guess: nothing was measured before."""


@dataclass(eq=False)
class Track:
    """A line in the image."""

    id: int
    first_time: float
    """Time of the first sighting, s."""
    ends: FloatArray
    """In the last frame, (2, 2), normalised."""
    slope: float
    """Usual grey level slope across it, signed."""
    sightings: deque[Sighting] = field(default_factory=deque)
    rates: tuple[float, float] = (0.0, 0.0)
    """Motion across itself beside the rotation's, at both ends, px/s."""
    sigma: float = DEFAULTS.tracks.fresh_sigma_px
    """Of the prediction across the ruling, px."""
    misses: int = 0
    last_seen: float = 0.0
    config: TracksConfig = DEFAULTS.tracks
    moves: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """Of a rolling shutter's last image, see `MovingRulings`."""
    unsettled: Unsettled | None = None

    @property
    def lost(self) -> bool:
        """Whether it has not been found for too long."""
        return self.misses > self.config.max_misses

    def miss(self, time: float) -> None:
        """Take note that it was not found, s."""
        self.misses += 1
        if time - self.last_seen > self.config.max_miss_time:
            self.misses = max(self.misses, self.config.max_misses)
        self.sigma = min(self.config.sigma_growth * self.sigma, self.config.max_sigma_px)

    def mark_lost(self) -> None:
        """Follow it no longer."""
        self.misses = self.config.max_misses + 1


class LineSegments(NamedTuple):
    """N segments in an image."""

    ends: FloatArray
    """(N, 2, 2), normalised."""
    slopes: FloatArray
    """Grey level slopes across them, signed, (N,)."""

    @classmethod
    def of(cls, tracks: Sequence[Track]) -> "LineSegments":
        """Of tracks in the last frame."""
        ends = np.array([track.ends for track in tracks]).reshape(-1, 2, 2)
        return cls(ends, np.array([track.slope for track in tracks]))
