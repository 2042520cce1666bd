# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The window: states, the graph between them, and its solution."""

import math
from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.imu_intervals import imu_interval
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_map import LineMap
from ruledgraph.backend.rest_factors import rest_factors
from ruledgraph.backend.start import Start
from ruledgraph.backend.state_sequence import StateSequence
from ruledgraph.backend.states import Interval, StateNode, add_priors
from ruledgraph.backend.time_offset import OffsetLink
from ruledgraph.backend.window_solver import WindowSolver
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
        first = first_state(start)
        self._states = StateSequence(first)
        self.line_map = LineMap(calibration, config, start.lines)
        self._solver = WindowSolver(self._states, self.line_map, config)
        self.time_offset = start.time_offset
        """Beyond the calibration's, as of the newest interval, when it is estimated."""
        if start.time_offset is not None:
            self.time_offset = start.time_offset.moved(correction)
        self.first_stamp = start.stamp
        self.solved = -math.inf
        """Time of the newest state that was optimised, s."""
        self._update = GraphUpdate()
        add_priors(self._update.factors, first)
        self._update.insert(first)

    @property
    def nodes(self) -> deque[StateNode]:
        """The states, oldest first."""
        return self._states.nodes

    @property
    def intervals(self) -> deque[Interval]:
        """Between the states."""
        return self._states.intervals

    @property
    def newest(self) -> StateNode:
        """The latest state."""
        return self._states.newest

    @property
    def lines(self) -> dict[int, Landmark]:
        """The lines of the graph by their ids."""
        return self.line_map.lines

    @property
    def recoveries(self) -> list[str]:
        """Why the smoother had to be rebuilt, each time."""
        return self._solver.recoveries

    @property
    def rests_since(self) -> float:
        """Time of the first state of the rest that goes on, or of the newest state, s."""
        return self._states.rests_since

    def is_plausible(self) -> bool:
        """Whether the newest state can be one of a carried or flown camera and its IMU."""
        return not self._solver.has_failed and self.newest.keeps(self._config.integrity)

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
        before, latest = self.newest, self._states.latest_interval
        again = 0
        if latest is not None and not latest.is_known and not imu.is_lost(before.time):
            again = 1
            stamps, times = [latest.stamps[-1], *stamps], [before.time, *times]
        previous_link, link = self._states.latest_link, self._link(before, correction)
        interval, new = imu_interval(
            before, stamps, times, again, imu, self._imu_noise, link, still
        )
        self._update.factors.add(interval.imu_factors[0])
        if link is not None:
            self._add_link(link, previous_link)
        self._states.append(interval, new)
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
        self._solver.solve(self._update)
        self._update = GraphUpdate()
        self.solved = self.newest.time
        link = self._states.latest_link
        if link is not None:
            self.time_offset = link.offset
        self.line_map.judge(self.intervals[-1])
        return gone

    def _drop_old(self) -> list[Interval]:
        oldest = self.newest.time - self._config.window.lag
        gone = []
        while (interval := self._states.pop_before(oldest)) is not None:
            self._solver.read_covariance(interval.node)
            gone.append(interval)
            for line, factor, _, _ in interval.observations:
                line.linearization_frozen |= factor.spec.keys[-1] == line.key
        self.line_map.retire(oldest)
        return gone

    def read_smoothed_covariances(self) -> None:
        """Of all states, as they are known now."""
        for node in self.nodes:
            self._solver.read_covariance(node)


def first_state(start: Start) -> StateNode:
    """The state of a start; its pose, velocity and bias are independent."""
    covariance = np.zeros((15, 15))
    of_pose, of_velocity, of_bias = blocks(covariance)
    of_pose[:] = start.pose_covariance
    of_velocity[:] = np.eye(3) * start.velocity_sigma**2
    of_bias[:] = np.diag(np.square(start.bias_sigmas))
    return StateNode(0, start.time, start.state, start.bias, covariance)
