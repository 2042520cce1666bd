# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a start in motion is made from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import gtsam

from ruledgraph.backend.line_factors import compressed_points
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph_factors import FrameMotion, GeometricPoints, ImuSamples, preintegrate_frames
from ruledgraph_factors.closed_form import Planes


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
    time_offset: TimeOffset | None = None
    """How much later than their times the frames may have been taken; None: it is known."""
    edge_variance: float = 1.0
    """Of edge points, over that of `edges.sigma_px`."""

    @property
    def sigma(self) -> float:
        """Standard deviation of a point, normalised units."""
        return self.nominal_sigma * math.sqrt(self.edge_variance)

    @property
    def nominal_sigma(self) -> float:
        """The same by `edges.sigma_px`."""
        return self.config.edges.sigma_px / self.calibration.camera.focal_length

    @cached_property
    def points(self) -> list[GeometricPoints]:
        """Of its lines."""
        return [compressed_points(line.sightings) for line in self.seen]

    def motion(self, bias: gtsam.imuBias.ConstantBias, with_time: bool = False) -> FrameMotion:
        """From its start to all its frames, integrated with a bias of the IMU."""
        return preintegrate_frames(self.samples, self.times[0], self.times, bias, with_time)

    def planes(self) -> list[Planes]:
        """That its lines span with the camera."""
        body_R_cam = self.calibration.body_T_cam.rotation().matrix()
        return [
            Planes.of(line.frames, points, body_R_cam, self.sigma)
            for line, points in zip(self.seen, self.points, strict=True)
        ]
