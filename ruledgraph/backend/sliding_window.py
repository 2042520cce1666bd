# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The window: states, the graph between them, and its solution."""

import math
from collections import deque
from collections.abc import Iterable, Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother, SmootherError
from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.imu_intervals import imu_interval
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_map import LineMap
from ruledgraph.backend.recovery import rebuilt
from ruledgraph.backend.rest_factors import rest_factors, resting
from ruledgraph.backend.start import Start
from ruledgraph.backend.states import Interval, StateNode, add_priors
from ruledgraph.backend.time_offset import OffsetLink
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import blocks
from ruledgraph.core.line_observations import LineTrack
from ruledgraph.imu.buffer import ImuBuffer


class Window:
    """Fixed-lag smoothing over states and lines.

    Use `extend` for each new state, then `optimize`. `correction` is what the start's frames were
    timed with beyond the calibration's time offset, s.
    """

    def __init__(
        self, calibration: Calibration, config: Config, start: Start, correction: float = 0.0
    ) -> None:
        self._config = config
        self._imu_noise = calibration.imu_noise
        self._smoother = self._fresh_smoother()
        covariance = np.zeros((15, 15))
        of_pose, of_velocity, of_bias = blocks(covariance)
        of_pose[:] = start.pose_covariance
        of_velocity[:] = np.eye(3) * start.velocity_sigma**2
        of_bias[:] = np.diag(np.square(start.bias_sigmas))
        first = StateNode(0, start.time, start.state, start.bias, covariance)
        self.time_offset = start.time_offset
        """Beyond the calibration's, as of the newest interval, when it is estimated."""
        if start.time_offset is not None:
            self.time_offset = start.time_offset.moved(correction)
        self.first_stamp = start.stamp
        self.nodes = deque([first])
        self.intervals: deque[Interval] = deque()
        self.line_map = LineMap(calibration, config, start.lines)
        self.recoveries: list[str] = []
        """Why the window had to be rebuilt, each time."""
        self.solved = -math.inf
        """Time of the newest state that was optimised, s."""
        self._broken = False
        self._update = GraphUpdate()
        add_priors(self._update.factors, first)
        self._update.insert(first)

    def _fresh_smoother(self, dogleg: bool = False) -> FixedLagSmoother:
        return FixedLagSmoother(self._config.window, dogleg)

    @property
    def newest(self) -> StateNode:
        """The latest state."""
        return self.nodes[-1]

    @property
    def lines(self) -> dict[int, Landmark]:
        """The lines of the graph by their ids."""
        return self.line_map.lines

    @property
    def rests_since(self) -> float:
        """Time of the first state of the rest that goes on, or of the newest state, s."""
        rest = resting(self.intervals)
        return rest[-1].node.time if rest else self.newest.time

    def is_plausible(self) -> bool:
        """Whether the newest state can be one of a carried or flown camera and its IMU."""
        return not self._broken and self.newest.keeps(self._config.integrity)

    # -- growing ---------------------------------------------------------------------------------

    def extend(
        self,
        stamps: Sequence[int],
        times: Sequence[float],
        imu: ImuBuffer,
        tracks: Iterable[LineTrack],
        still: bool,
        correction: float = 0.0,
    ) -> None:
        """Add a state at the last of the frames that follow the newest one, with its factors.

        Args:
            stamps: of the frames, ns.
            times: of the frames, s, increasing, after the newest state.
            imu: samples that cover them.
            tracks: of the lines to be taken in, usually all.
            still: whether the body has rested since the newest state, and for some time.
            correction: of the calibration's time offset, that `times` were computed with, s.
        """
        before = self.newest
        unplaced = bool(self.intervals) and not self.intervals[-1].is_known
        again = int(unplaced and not imu.is_lost(before.time))
        if again:
            stamps, times = [self.intervals[-1].stamps[-1], *stamps], [before.time, *times]
        previous_link = self.intervals[-1].link if self.intervals else None
        link = self._link(before, correction)
        interval, new = imu_interval(
            before, stamps, times, again, imu, self._imu_noise, link, still
        )
        self._update.factors.add(interval.imu_factors[0])
        if link is not None:
            self._add_link(link, previous_link)
        self.intervals.append(interval)
        self.nodes.append(new)
        self._update.insert(new)
        for factor in rest_factors(self.intervals, new.time, self._config.rest):
            self._update.factors.add(factor)
        self.line_map.observe(tracks, self.intervals, new.time, self._update)

    def _link(self, node: StateNode, correction: float) -> OffsetLink | None:
        """The time offset of the frames after a state, when that is estimated."""
        if self.time_offset is None:
            return None
        value, sigma = self.time_offset
        return OffsetLink(node.index, node.time, correction, value - correction, sigma)

    def _add_link(self, link: OffsetLink, before: OffsetLink | None) -> None:
        random_walk = self._config.time_offset.random_walk
        factor = link.random_walk_factor(before, random_walk) if before else link.prior()
        self._update.factors.add(factor)
        self._update.values.insert(link.key, link.shift)
        self._update.times[link.key] = link.time

    # -- solving ---------------------------------------------------------------------------------

    def optimize(self) -> list[Interval]:
        """Take in what was added since the last time.

        Returns:
            The intervals that left the window, with their final estimates.
        """
        gone = self._drop_old()
        self.line_map.reanchor(self._update)
        was_dogleg = self._smoother.dogleg
        try:
            self._solve(self._update)
        except SmootherError as failure:
            self.recoveries.append(f"at {self.newest.time:.2f} s: {failure}")
            self._recover()
        else:
            if self._smoother.dogleg and not was_dogleg:
                trouble = f"at {self.newest.time:.2f} s: {self._smoother.trouble}"
                self.recoveries.append(f"{trouble}; solved by Dogleg steps")
        self._update = GraphUpdate()
        self.solved = self.newest.time
        self._read_covariances()
        self.line_map.judge(self.intervals[-1])
        return gone

    def _solve(self, update: GraphUpdate) -> None:
        news = update.factors, update.values, update.times
        self._read(self._smoother.update(*news, self._check))

    def _drop_old(self) -> list[Interval]:
        oldest = self.newest.time - self._config.window.lag
        gone = []
        while self.intervals and self.intervals[0].node.time < oldest:
            interval = self.intervals.popleft()
            self._read_covariance(interval.node)
            gone.append(interval)
            self.nodes.popleft()
            for line, factor, _, _ in interval.observations:
                line.fixed |= factor.spec.keys[-1] == line.key
        self.line_map.retire(oldest)
        return gone

    def _read(self, estimate: gtsam.Values) -> None:
        for node in self.nodes:
            pose, velocity = estimate.atPose3(X(node.index)), estimate.atVector(V(node.index))
            node.state = gtsam.NavState(pose, velocity)
            node.bias = estimate.atConstantBias(B(node.index))
        for link in filter(None, (interval.link for interval in self.intervals)):
            link.shift = estimate.atDouble(link.key)
        self.line_map.read(estimate, self._smoother.linearization_point())

    def _check(self, estimate: gtsam.Values) -> bool:
        """Whether the newest state is close to the IMU's prediction; it must not be far off."""
        k, predicted = self.newest.index, self.newest.state
        position, velocity = estimate.atPose3(X(k)).translation(), estimate.atVector(V(k))
        jump = float(np.linalg.norm(position - predicted.position()))
        change = float(np.linalg.norm(velocity - predicted.velocity()))
        limits = self._config.window
        if not (jump < limits.jump_position and change < limits.jump_velocity):
            raise SmootherError(f"the estimate jumped by {jump:.2g} m, {change:.2g} m/s")
        return jump < limits.step_position and change < limits.step_velocity

    def _read_covariances(self) -> None:
        self._read_covariance(self.newest)
        link = self.intervals[-1].link
        if link is not None:
            variance = self._smoother.covariance(link.key)
            if variance is not None:
                link.sigma = float(np.sqrt(variance[0, 0]))
            self.time_offset = link.offset
        self.line_map.read_covariances(self._smoother, self.newest.time)

    def _read_covariance(self, node: StateNode) -> None:
        keys = X(node.index), V(node.index), B(node.index)
        covariance = self._smoother.joint_covariance(keys)
        if covariance is not None:
            node.covariance = covariance

    def read_smoothed_covariances(self) -> None:
        """Of all states, as they are known now."""
        for node in self.nodes:
            self._read_covariance(node)

    def _recover(self) -> None:
        """A new smoother from the window's own states, marginals and data; failing that, without
        its lines.
        """
        for with_lines in (True, False):
            if not with_lines:
                self.line_map.reject_all()
            try:
                self._smoother = self._fresh_smoother(dogleg=True)
                lines = self.lines.values()
                update = rebuilt(self.nodes, self.intervals, lines, self._config)
                self._solve(update)
                self.line_map.keep(update.times)
                return
            except SmootherError:
                continue
        self._broken = True
