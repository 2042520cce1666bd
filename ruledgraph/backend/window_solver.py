# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The solution of a window: by the fixed-lag smoother, and by a new one when that has failed."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother, SmootherError
from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.line_manager import LineManager
from ruledgraph.backend.recovery import rebuilt
from ruledgraph.backend.state_sequence import StateSequence
from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.core.config import Config


class WindowSolver:
    """Solves for states and lines and writes what it finds into them."""

    def __init__(self, states: StateSequence, line_manager: LineManager, config: Config) -> None:
        self._states = states
        self._line_manager = line_manager
        self._config = config
        self._smoother = FixedLagSmoother(config.window)
        self._predicted = states.newest.state
        self.recoveries: list[str] = []
        """Why the smoother had to be rebuilt, each time."""
        self.has_failed = False
        """Whether a new smoother, without the lines, failed as well."""

    def solve(self, update: GraphUpdate) -> None:
        """Update the smoother; states and lines get the estimate and their covariances."""
        was_dogleg, time = self._smoother.dogleg, self._states.newest.time
        self._predicted = self._states.newest.state
        try:
            self._solve_and_recentre(update)
        except SmootherError as failure:
            self.recoveries.append(f"at {time:.2f} s: {failure}")
            self._recover()
        else:
            if self._smoother.dogleg and not was_dogleg:
                reason = f"at {time:.2f} s: {self._smoother.dogleg_reason}"
                self.recoveries.append(f"{reason}; solved by Dogleg steps")
        self._read_covariances()

    def _solve_and_recentre(self, update: GraphUpdate) -> None:
        """Solve, and again while lines move far from where they are linearised: of near ones whose
        distance was unknown the first images after a rest mean ten times the motion else.
        """
        intervals = self._states.intervals
        self._line_manager.update_variables(intervals, update)
        self._solve(update)
        for _ in range(self._config.window.updates):
            again = GraphUpdate()
            if not self._line_manager.update_variables(intervals, again):
                break
            self._solve(again)

    def _solve(self, update: GraphUpdate) -> None:
        added = update.factors, update.values, update.times
        estimate = self._smoother.update(*added, self._check, update.removal)
        self._states.read(estimate)
        self._line_manager.read(estimate, self._smoother.linearization_point())

    def _check(self, estimate: gtsam.Values) -> bool:
        """Whether the newest state is close to where it was, by the IMU or the last solution; it
        must not be far from the IMU's prediction.
        """
        newest, limits = self._states.newest, self._config.window
        pose, velocity = estimate.atPose3(X(newest.index)), estimate.atVector(V(newest.index))
        found = gtsam.NavState(pose, velocity)
        jump, change = _apart(found, self._predicted)
        if not (jump < limits.jump_position and change < limits.jump_velocity):
            raise SmootherError(f"the estimate jumped by {jump:.2g} m, {change:.2g} m/s")
        step, step_velocity = _apart(found, newest.state)
        return step < limits.step_position and step_velocity < limits.step_velocity

    def _recover(self) -> None:
        """A new smoother from the window's own states, marginals and data; failing that, without
        its lines.
        """
        for with_lines in (True, False):
            if not with_lines:
                self._line_manager.reject_all()
            try:
                self._smoother = FixedLagSmoother(self._config.window, dogleg=True)
                lines, states = self._line_manager.lines.values(), self._states
                update = rebuilt(states.nodes, states.intervals, lines, self._config)
                self._solve(update)
                self._line_manager.keep_only(update.times)
                return
            except (SmootherError, np.linalg.LinAlgError):
                continue  # the latter where a covariance is none
        self.has_failed = True

    def _read_covariances(self) -> None:
        intervals, newest = self._states.intervals, self._states.newest
        self.read_covariance(newest, intervals[-1] if intervals else None)
        self._read_line_covariances(newest.time)

    def _read_line_covariances(self, now: float) -> None:
        """Of the lines whose covariance is the oldest: it shrinks as a line is seen, so that an
        old one errs on the safe side.
        """
        by_age = sorted(self._line_manager.lines.values(), key=lambda line: line.covariance_time)
        stalest = by_age[: self._config.lines.covariances_per_state]
        if not stalest:
            return
        # Together: most of the time goes into what they have in common.
        joint = self._smoother.joint_covariance([line.key for line in stalest])
        for i, line in enumerate(stalest):
            line.covariance_time = now
            if joint is not None:
                line.covariance = joint[4 * i : 4 * i + 4, 4 * i : 4 * i + 4]

    def read_covariance(self, node: StateNode, interval: Interval | None = None) -> None:
        """Of a state, and of an interval's variables of the camera, by the smoother's present
        estimate.
        """
        of_camera = [] if interval is None else interval.camera.estimated
        # All together: most of the time goes into what they have in common.
        keys = X(node.index), V(node.index), B(node.index), *(each.key for each in of_camera)
        covariance = self._smoother.joint_covariance(keys)
        if covariance is None:
            return
        node.covariance = covariance[:15, :15]
        first = 15
        for variable in of_camera:
            part = slice(first, first + variable.SIZE)
            variable.read_covariance(covariance[part, part])
            first += variable.SIZE


def _apart(one: gtsam.NavState, other: gtsam.NavState) -> tuple[float, float]:
    """Distances of two states' positions, m, and velocities, m/s."""
    return (
        float(np.linalg.norm(one.position() - other.position())),
        float(np.linalg.norm(one.velocity() - other.velocity())),
    )
