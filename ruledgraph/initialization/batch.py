# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The batch solution of a first window."""

from copy import copy
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.start import InitialLine
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.batch_problem import (
    BIAS,
    POSE,
    TIME,
    VELOCITY,
    BatchProblem,
    Estimate,
)
from ruledgraph.initialization.first_window import FirstWindow
from ruledgraph.initialization.initial_values import InitialValues
from ruledgraph.initialization.levenberg_marquardt import minimized
from ruledgraph_factors import FactorError, triangulate_line

# A line is replaced by one that is triangulated anew when its error falls by more.
_BETTER = 1.0


class Effort(NamedTuple):
    """How thoroughly a batch is solved."""

    iterations: int
    chunk: int
    """Frames of a line that share one loss: a track that jumps does so for good."""


ROUGH, FINE = Effort(15, 6), Effort(30, 2)


class Batch:
    """The batch problem, solved from one initial value on.

    Variables: pose and velocity at the window's first frame, bias, a `LineChart` for each line and,
    when it is estimated, the time offset. The pose's position and yaw are fixed. See `solve` for
    the loss and what it raises.
    """

    def __init__(
        self, window: FirstWindow, initial: InitialValues, cauchy_px: float, effort: Effort
    ) -> None:
        self._window = window
        self._upright = initial.upright
        self._charts = list(initial.charts)
        state = gtsam.Values()
        state.insert(POSE, gtsam.Pose3(initial.attitude, np.zeros(3)))
        state.insert(VELOCITY, initial.velocity)
        state.insert(BIAS, initial.bias)
        if window.time_offset is not None:
            state.insert(TIME, 0.0)
        self._at = Estimate(state, np.zeros((len(self._charts), 4)))
        self.solve(cauchy_px, effort)

    # -- solution --------------------------------------------------------------------------------

    @property
    def pose(self) -> gtsam.Pose3:
        """world_T_body at the window's start."""
        return self._at.state.atPose3(POSE)

    @property
    def velocity(self) -> FloatArray:
        """In the world, at the window's start, (3,), m/s."""
        return np.asarray(self._at.state.atVector(VELOCITY))

    @property
    def bias(self) -> gtsam.imuBias.ConstantBias:
        """Of the IMU."""
        return self._at.state.atConstantBias(BIAS)

    @property
    def residual_offset(self) -> float:
        """How much later than their times the frames were taken, s."""
        state = self._at.state
        return float(state.atDouble(TIME)) if state.exists(TIME) else 0.0

    def lines(self) -> list[InitialLine]:
        """All of them; each has a prior, so that none is indeterminate."""
        covariances = self._problem.linearize(self._at).line_covariances()
        each = zip(self._charts, self._at.deltas, covariances, strict=True)
        return [InitialLine.at(*line) for line in each]

    # -- solving ---------------------------------------------------------------------------------

    def solve(self, cauchy_px: float, effort: Effort = FINE) -> None:
        """Levenberg-Marquardt with that constant of the robust loss.

        Raises:
            numpy.linalg.LinAlgError: for a system that is indeterminate.
        """
        self._cauchy_px = cauchy_px
        self._recentre()
        self._problem = self._built(effort.chunk)
        self._at = minimized(self._problem, self._at, effort.iterations)
        self.error = self._problem.cost(self._at)

    def solved_again(self, window: FirstWindow, cauchy_px: float) -> "Batch":
        """Another one of the same window with other noise of its edges, begun here; see `solve`."""
        other = copy(self)
        other._window = window
        other.solve(cauchy_px)
        return other

    def _built(self, chunk: int) -> BatchProblem:
        return BatchProblem(
            self._window, self._upright, self.bias, self._charts, self._cauchy_px, chunk
        )

    def _recentre(self) -> None:
        """Charts about the lines: their priors would draw them, and with them the scale, to the
        distance at which a hypothesis began.
        """
        charts = [
            chart.recentred(delta)[0]
            for chart, delta in zip(self._charts, self._at.deltas, strict=True)
        ]
        self._charts = charts
        self._at = self._at._replace(deltas=np.zeros((len(charts), 4)))

    def triangulate_anew(self) -> None:
        """Replace lines, stuck at a wrong distance or direction, that fit better when the motion
        found so far places them, by the loss of the last `solve`.
        """
        problem = self._built(FINE.chunk)
        before = problem.line_losses(self._at)
        old_charts, old_deltas = list(self._charts), self._at.deltas
        body_T_cam = self._window.calibration.body_T_cam
        poses = problem.motion.poses(
            gtsam.NavState(self.pose, self.velocity),
            self.bias,
            self._window.config.imu.gravity_in_world,
            time_shift=self.residual_offset,
        )
        cameras = [pose.compose(body_T_cam) for pose in poses]
        deltas = old_deltas.copy()
        for i, line in enumerate(self._window.seen):
            seen_from = [cameras[frame] for frame in line.frames]
            try:
                found = triangulate_line(seen_from, self._window.points[i], self._window.sigma)
            except FactorError:
                continue
            self._charts[i], deltas[i] = found.chart, 0.0
        self._at = self._at._replace(deltas=deltas)
        after = self._built(FINE.chunk).line_losses(self._at)
        for i in np.flatnonzero(~(after < before - _BETTER)).tolist():
            self._charts[i], deltas[i] = old_charts[i], old_deltas[i]

    # -- verdict ---------------------------------------------------------------------------------

    def misfits(self, sigma: float) -> list[FloatArray]:
        """See `BatchProblem.misfits`."""
        return self._problem.misfits(self._at, sigma)

    def state_covariance(self) -> FloatArray:
        """Of pose, velocity and bias at the window's start, (15, 15).

        See `BorderedSystem.state_covariance`. The time offset counts as known: what it leaves open
        is for the window to find.

        Raises:
            numpy.linalg.LinAlgError: when they are indeterminate.
        """
        is_timed = self._at.state.exists(TIME)
        return self._problem.linearize(self._at).state_covariance(fixed=int(is_timed))

    def velocities(self) -> list[tuple[FloatArray, FloatArray]]:
        """At the window's start and at its end, in the world, (3,), with covariances, (3, 3).

        Raises:
            numpy.linalg.LinAlgError: when they are indeterminate.
        """
        covariance = self.state_covariance()
        R = self.pose.rotation().matrix()
        gained = self._problem.motion.corrected(self.bias.vector())[-1, 6:9]
        by_state = np.zeros((3, 15))
        by_state[:, :3] = -R @ gtsam.SO3.Hat(gained)
        by_state[:, 6:9] = np.eye(3)
        by_state[:, 9:] = R @ self._problem.motion.bias_jacobian[-1, 6:9]
        state = gtsam.NavState(self.pose, self.velocity)
        gravity = self._window.config.imu.gravity_in_world
        last = self._problem.motion.velocities(state, self.bias, gravity)[-1]
        return [
            (self.velocity, covariance[6:9, 6:9]),
            (last, by_state @ covariance @ by_state.T),
        ]
