# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Integrity monitoring: whether the estimate contradicts the IMU or the lines, and covariances
for errors that the window's marginals do not show.

- Noise is larger or smaller than the window takes it for: marginals are multiplied by the variance
  factor. A position keeps what a time of larger noise has added to it.
- All lines are parallel: only the IMU observes the motion along them, but marginals of factors
  linearised at other points say otherwise.
- The estimate moves while the body rests.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.bias_jump import JUMP_DOF
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import StateNode
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Covariances, Innovation, Status
from ruledgraph.core.messages import Messages
from ruledgraph.integrity.contradictions import ImuCheck, LineCheck
from ruledgraph.integrity.gauge import UP, GaugeUncertainty
from ruledgraph.integrity.parallel_lines import ParallelLines
from ruledgraph.integrity.rest_slide import RestSlide
from ruledgraph.integrity.variance_factor import VarianceFactor


class _Inflation(NamedTuple):
    """Of the window's covariances, and what it leaves of the position in the world."""

    factor: float
    largest: FloatArray
    """Bound of the position's marginal so far, (3, 3), m^2."""
    added: FloatArray
    """What inflation has added to it, (3, 3), m^2."""


class IntegrityMonitor:
    """Monitors a segment state by state.

    Args:
        gauge_uncertainty: of the segment's position and yaw at its start.
        warnings: messages for the user.
        config: all settings.
        on_trial: whether the start is not accepted yet.
    """

    def __init__(
        self,
        gauge_uncertainty: GaugeUncertainty,
        warnings: Messages,
        config: Config,
        on_trial: bool = False,
    ) -> None:
        self._limits = config.integrity
        self._start_gauge = self._base_gauge = gauge_uncertainty
        self._imu = ImuCheck(warnings, config.integrity)
        self._lines = LineCheck(warnings, config.integrity)
        self._variance = VarianceFactor(config.integrity, math.inf if on_trial else -math.inf)
        # By all innovations: a start's, too, show that noise is no larger than they are.
        self._of_innovations = VarianceFactor(config.integrity)
        # By the ratios of `bias_jump` where nothing jumped, which count as innovations.
        self._of_jumps = VarianceFactor(config.integrity)
        self._parallel = ParallelLines(config.integrity)
        self._rest_slide = RestSlide(warnings, config.rest.slide_warning)
        self._inflation = _Inflation(1.0, np.zeros((3, 3)), np.zeros((3, 3)))
        # The gauge uncertainty with all that applies at the newest state.
        self._gauge = gauge_uncertainty

    def confirm(self, time: float) -> None:
        """The start, on trial before, is accepted at a time, s; see `VarianceFactor`."""
        self._variance.counts_from = time

    @property
    def is_contradicted(self) -> bool:
        """Whether the images contradict the IMU, or lines the estimate."""
        return self._imu.contradicts or self.lines_misfit

    @property
    def lines_misfit(self) -> bool:
        """Whether too many lines do not fit the estimate, and since then not `lines_fit`."""
        return self._lines.misfit

    @property
    def lines_fit(self) -> bool:
        """Whether nearly all lines fit the estimate: more than where `lines_misfit` begins."""
        return self._lines.fit

    @property
    def lost(self) -> bool:
        """Whether half of the lines do not fit the estimate, or too many have not for long."""
        return self._lines.lost

    @property
    def parallel(self) -> bool:
        """Whether all lines have been parallel for long."""
        return self._parallel.for_long

    @property
    def jump_threshold(self) -> float:
        """From which likelihood ratio on the IMU's biases jump, see `bias_jump`: an F-test. They do
        not while a start is on trial, where a contradiction speaks against the start, or where many
        lines did not fit before: it speaks against these. The noise is that of the ratios before.

        They do whatever the ratio where the innovation contradicts the IMU, and lines have agreed
        since its prediction: an interval alone shows little of a slow drift, and once the lines
        have followed it, nothing.
        """
        on_trial = self._variance.counts_from == math.inf
        if on_trial or not self.lines_fit:
            return math.inf
        since = self._imu.unlikely_since
        if since is not None and self._lines.last_misfit_time <= since:
            return -math.inf
        return self._of_jumps.quantile(JUMP_DOF, self._limits.confidence)

    def update(self, window: Window, still: bool, stayed_at: gtsam.NavState | None = None) -> None:
        """Take in the newest state, optimised, whether the body has been at rest until then, and
        where it was when lines began to say so, if the IMU did not.
        """
        node = window.newest
        was_contradicted = self.is_contradicted
        self._imu.update(window.innovation, node.time, self._of_innovations, window.jumped)
        for factor in (self._variance, self._of_innovations):
            factor.update(window.innovation, node.time)
        if window.jump_test is not None and not window.jumped:
            before = window.intervals[-1].node.time
            self._of_jumps.update(Innovation(window.jump_test.ratio, JUMP_DOF, before), node.time)
        self._lines.update(window, still)
        if was_contradicted and not self.is_contradicted:
            self._keep_error(node)
        self._inflate(node, max(1.0, self._variance.estimate))
        self._add_to_gauge(self._parallel.update(window, self._inflation.factor))
        stayed = None if stayed_at is None else stayed_at.position()
        self._add_to_gauge(self._rest_slide.update(node.state.position(), node.time, still, stayed))
        more = self._inflation.added - (self._inflation.factor - 1.0) * _of_position(node)
        position = self._base_gauge.position_covariance + self._parallel.covariance()
        position = position + self._rest_slide.covariance() + more
        self._gauge = replace(self._base_gauge, position_covariance=position)

    def _add_to_gauge(self, position: FloatArray) -> None:
        """Add a covariance of the position, (3, 3), for good."""
        if position.any():
            position = self._base_gauge.position_covariance + position
            self._base_gauge = replace(self._base_gauge, position_covariance=position)

    def covariances(
        self, covariances: Covariances, pose: gtsam.Pose3, velocity: FloatArray
    ) -> Covariances:
        """Marginals of a state times the variance factor, plus the gauge uncertainty."""
        factor = self._variance.of_covariances
        of_pose, of_velocity, of_bias = (factor * block for block in covariances)
        return self._gauge.added_to((of_pose, of_velocity, of_bias), pose, velocity)

    def rated(
        self, status: Status, covariances: Covariances, pose: gtsam.Pose3, velocity: FloatArray
    ) -> Status:
        """The status, `degraded` instead of `tracking` where position and velocity are not known
        well enough, by the covariances that are handed out with it.

        Relative to the start of the segment: what a gap before it has left does not count.
        """
        if status != "tracking":
            return status
        none = np.zeros((6, 6)), np.zeros((3, 3)), np.zeros((6, 6))
        before = self._start_gauge.added_to(none, pose, velocity)
        of_pose, of_velocity = covariances[0] - before[0], covariances[1] - before[1]
        limits = self._limits
        known = (
            np.linalg.eigvalsh(of_velocity)[-1] < limits.tracking_velocity_sigma**2
            and np.linalg.eigvalsh(of_pose[3:, 3:])[-1] < limits.tracking_position_sigma**2
        )
        return "tracking" if known else "degraded"

    def _keep_error(self, node: StateNode) -> None:
        """Of position and yaw, from while images and IMU or lines and estimate disagreed."""
        position, excess = _of_position(node), self._inflation.factor - 1.0
        up = node.state.attitude().matrix().T @ UP
        self._base_gauge = self._base_gauge.inflated(
            _enclosing(self._inflation.added, excess * position),
            excess * float(up @ node.covariances[0][:3, :3] @ up),
            node.state.position(),
        )
        self._inflation = self._inflation._replace(added=np.zeros((3, 3)))

    def _inflate(self, node: StateNode, factor: float) -> None:
        """The position keeps its error: the inflated part as of now, and that of further drift."""
        position, before = _of_position(node), self._inflation
        largest = _enclosing(before.largest, position)
        came = (factor - 1.0) * (largest - before.largest)
        added = _enclosing(before.added + came, (factor - 1.0) * position)
        self._inflation = _Inflation(factor, largest, added)


def _of_position(node: StateNode) -> FloatArray:
    """Covariance of the body's position in the world, as the window gives it."""
    R = node.state.attitude().matrix()
    return np.asarray(R @ node.covariances[0][3:, 3:] @ R.T)


def _enclosing(one: FloatArray, other: FloatArray) -> FloatArray:
    """A covariance that is nowhere smaller than either."""
    values, vectors = np.linalg.eigh(one - other)
    return np.asarray(other + (vectors * np.maximum(values, 0.0)) @ vectors.T)
