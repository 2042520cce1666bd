# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What comes out of an odometry, and how it is handed out."""

import time as clock
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import gtsam

from ruledgraph.backend.landmarks import LineEstimate
from ruledgraph.backend.time_offset import NO_OFFSET, TimeOffset
from ruledgraph.calibration.sensors import FloatArray
from ruledgraph.core.timing import Messages, Timing
from ruledgraph.integrity.segments import Covariances

Status = Literal["tracking", "still", "dead reckoning", "doubtful"]


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known of one frame."""

    stamp: int
    """ns, the frame's own."""
    world_T_body: gtsam.Pose3
    velocity: FloatArray
    """Of the body in the world, (3,), m/s."""
    bias: gtsam.imuBias.ConstantBias
    covariances: Covariances
    """Of pose (6, 6), velocity (3, 3) and bias (6, 6), as of the last knot when it was new."""
    lines: int
    """Lines of the graph that were seen in the frame."""
    status: Status
    at_knot: bool
    """Whether the frame is a knot's, optimised with all before it, or predicted from one."""
    segment: int = 0
    """Counts from 0; between two of them there is a gap or a failure."""
    time_offset: TimeOffset = NO_OFFSET
    """t_imu - t_cam, s, as of the last knot; without deviation where it is not estimated."""


class Output:
    """Estimates and lines until they are taken, messages and timings."""

    def __init__(self) -> None:
        self.warnings = Messages()
        self.recoveries = Messages()
        self.timings: dict[str, Timing] = defaultdict(Timing)
        """How long each stage took."""
        self._live: list[Estimate] = []
        self._smoothed: list[Estimate] = []
        self._lines: list[LineEstimate] = []

    def take_live(self) -> list[Estimate]:
        """Estimates as known at each frame's time, since the last call."""
        taken, self._live = self._live, []
        return taken

    def take_smoothed(self) -> list[Estimate]:
        """Estimates of the frames that left the window, since the last call."""
        taken, self._smoothed = self._smoothed, []
        return taken

    def take_lines(self) -> list[LineEstimate]:
        """Lines that left the window, since the last call."""
        taken, self._lines = self._lines, []
        return taken

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = clock.perf_counter()
        yield
        self.timings[stage].add(clock.perf_counter() - start)
