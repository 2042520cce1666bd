# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far estimates may be believed beyond what the window says of them.

Four things the window cannot know: that images and IMU contradict each other or lines miss their
points, where every factor is as certain as its noise figures say; that it is lost, where the robust
loss gives up most lines and what is left agrees; that lines which are all parallel leave the motion
along them to the IMU, where marginals of factors that were linearised elsewhere say otherwise; and
that it moves a body which rests.
"""

from dataclasses import replace

import gtsam
import numpy as np

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import StateNode
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Covariances
from ruledgraph.core.timing import Messages
from ruledgraph.integrity.contradictions import ImuCheck, LineCheck
from ruledgraph.integrity.gauge import GaugeUncertainty
from ruledgraph.integrity.parallel_lines import ParallelLines
from ruledgraph.integrity.rest_slide import RestSlide

_UP = np.array([0.0, 0.0, 1.0])


class IntegrityMonitor:
    """Judges a segment state by state.

    Args:
        drift: what is open of the segment's position and heading from the beginning.
        warnings: where to tell.
        config: all settings.
    """

    def __init__(self, drift: GaugeUncertainty, warnings: Messages, config: Config) -> None:
        self._fade_time = config.integrity.fade_time
        self._drift = drift
        self._imu = ImuCheck(warnings, config.integrity)
        self._lines = LineCheck(warnings, config.integrity)
        self._parallel = ParallelLines(config.integrity)
        self._rest = RestSlide(warnings, config.rest.slide_warning)
        # How many times as large the window's covariances are for all that is wrong.
        self._excess = 1.0
        # In the world: the position's covariance by the window so far, and what it grew by.
        self._record = self._open_position = np.zeros((3, 3))
        self._time = 0.0
        # What is open of position and heading for all that is known by now.
        self._open = drift
        self.disagree = False
        """Whether images and IMU do, or lines and estimate."""

    @property
    def misfits(self) -> bool:
        """Whether too many lines do not fit the estimate."""
        return self._lines.misfits

    @property
    def lost(self) -> bool:
        """Whether most lines do not fit the estimate."""
        return self._lines.lost

    @property
    def parallel(self) -> bool:
        """Whether all lines have been parallel for long."""
        return self._parallel.for_long

    def update(self, window: Window, still: bool) -> None:
        """Take in the newest state, optimised, and whether the body has been at rest until then."""
        node = window.newest
        elapsed, self._time = node.time - self._time, node.time
        excess = max(1.0, self._imu.excess(window), self._lines.excess(window, still))
        self._inflate(node, excess, elapsed)
        self._keep(self._parallel.update(window, self._excess))
        self._keep(self._rest.update(node.state.position(), node.time, still))
        more = self._open_position - (self._excess - 1.0) * _of_position(node)
        position = self._drift.position + self._parallel.covariance() + self._rest.covariance()
        self._open = replace(self._drift, position=position + more)

    def _keep(self, open_position: FloatArray) -> None:
        """From now on so much more is open of the position."""
        if open_position.any():
            self._drift = replace(self._drift, position=self._drift.position + open_position)

    def covariances(
        self, covariances: Covariances, pose: gtsam.Pose3, velocity: FloatArray
    ) -> Covariances:
        """Marginals of a state, inflated by what contradicts them, plus the gauge's uncertainty."""
        of_pose, of_velocity, of_bias = covariances
        # Of the bias lines say little.
        times = self._lines.share + self._excess - 1.0
        scaled = times * of_pose, times * of_velocity, self._excess * of_bias
        return self._open.added(scaled, pose, velocity)

    def _inflate(self, node: StateNode, excess: float, elapsed: float) -> None:
        disagreed, self.disagree = self.disagree, self._imu.contradicts or self.misfits
        position = _of_position(node)
        if disagreed and not self.disagree:
            # What went wrong meanwhile stays.
            up = node.state.attitude().matrix().T @ _UP
            self._drift = self._drift.grown(
                _enclosing(self._open_position, (self._excess - 1.0) * position),
                (self._excess - 1.0) * float(up @ node.covariances[0][:3, :3] @ up),
                node.state.position(),
            )
            self._excess, self._open_position = 1.0, np.zeros((3, 3))
        fading = 1.0 if self.disagree else float(np.exp(-elapsed / self._fade_time))
        self._excess = max(excess, fading * self._excess)
        # What went wrong with the position stays: as much as now, and what comes as it drifts on.
        record = _enclosing(self._record, position)
        came = (self._excess - 1.0) * (record - self._record)
        self._open_position = _enclosing(
            self._open_position + came, (self._excess - 1.0) * position
        )
        self._record = record


def _of_position(node: StateNode) -> FloatArray:
    """Covariance of the body's position in the world, as the window gives it."""
    R = node.state.attitude().matrix()
    return np.asarray(R @ node.covariances[0][3:, 3:] @ R.T)


def _enclosing(one: FloatArray, other: FloatArray) -> FloatArray:
    """A covariance that is nowhere smaller than either."""
    values, vectors = np.linalg.eigh(one - other)
    return np.asarray(other + (vectors * np.maximum(values, 0.0)) @ vectors.T)
