# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a start in motion is made from."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph_factors import ImuSamples


class Seen(NamedTuple):
    """A line in a window."""

    track: LineTrack
    frames: list[int]
    """Which frames of the window saw it."""
    sightings: list[Sighting]


@dataclass(frozen=True, eq=False)
class FirstWindow:
    """Frames with the lines seen in them, and the IMU between them."""

    samples: ImuSamples
    times: list[float]
    """Of its frames, s."""
    seen: Sequence[Seen]
    calibration: Calibration
    config: Config

    @property
    def sigma(self) -> float:
        """Standard deviation of a point, normalised units."""
        return self.config.start.sigma_px / self.calibration.camera.focal_length
