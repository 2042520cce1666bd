# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The batch solution of a first window."""

from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.line_factors import compressed_points
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.batch_covariance import state_covariance
from ruledgraph.initialization.batch_graph import (
    BIAS,
    LINES,
    POSE,
    VELOCITY,
    BatchGraph,
    time_offset_key,
)
from ruledgraph.initialization.first_window import FirstWindow
from ruledgraph.initialization.initial_values import InitialValues
from ruledgraph.initialization.prior import unknown_offset
from ruledgraph_factors import FactorError, LineChart, triangulate_line

_TOLERANCE = 1e-4
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
        self._is_timed = unknown_offset(window.config) is not None
        self.values = gtsam.Values()
        self.values.insert(BIAS, initial.bias)
        if self._is_timed:
            self.values.insert(time_offset_key(window), 0.0)
        self.values.insert(POSE, gtsam.Pose3(initial.attitude, np.zeros(3)))
        self.values.insert(VELOCITY, initial.velocity)
        for i in range(len(self._charts)):
            self.values.insert(LINES + i, np.zeros(4))
        self.solve(cauchy_px, effort)

    # -- solution --------------------------------------------------------------------------------

    @property
    def pose(self) -> gtsam.Pose3:
        """world_T_body at the window's start."""
        return self.values.atPose3(POSE)

    @property
    def velocity(self) -> FloatArray:
        """In the world, at the window's start, (3,), m/s."""
        return np.asarray(self.values.atVector(VELOCITY))

    @property
    def bias(self) -> gtsam.imuBias.ConstantBias:
        """Of the IMU."""
        return self.values.atConstantBias(BIAS)

    @property
    def residual_offset(self) -> float:
        """How much later than their times the frames were taken, s."""
        return float(self.values.atDouble(time_offset_key(self._window))) if self._is_timed else 0.0

    def line(self, i: int) -> tuple[LineChart, FloatArray]:
        """Chart and delta of a line."""
        return self._charts[i], np.asarray(self.values.atVector(LINES + i))

    # -- solving ---------------------------------------------------------------------------------

    def solve(self, cauchy_px: float, effort: Effort = FINE) -> None:
        """Levenberg-Marquardt with that constant of the robust loss.

        Raises:
            RuntimeError: for a system that is indeterminate.
            FactorError: when a line comes out through its camera.
        """
        self._cauchy_px = cauchy_px
        self._graph = self._built(effort.chunk)
        params = gtsam.LevenbergMarquardtParams()
        params.setMaxIterations(effort.iterations)
        params.setRelativeErrorTol(_TOLERANCE)
        # The priors are stiff: damping has to follow the diagonal.
        params.setDiagonalDamping(True)
        params.setlambdaUpperBound(1e10)
        factors = self._graph.factors
        self.values = gtsam.LevenbergMarquardtOptimizer(factors, self.values, params).optimize()
        self.error = factors.error(self.values)

    def _built(self, chunk: int) -> BatchGraph:
        return BatchGraph(
            self._window, self._upright, self.bias, self._charts, self._cauchy_px, chunk
        )

    def triangulate_anew(self) -> None:
        """Replace lines, stuck at a wrong distance or direction, that fit better when the motion
        found so far places them, by the loss of the last `solve`.
        """
        graph = self._built(FINE.chunk)
        before, values = graph.line_errors(self.values), gtsam.Values(self.values)
        charts = list(self._charts)
        body_T_cam = self._window.calibration.body_T_cam
        state = gtsam.NavState(self.pose, self.velocity)
        poses = graph.motion.poses(
            state,
            self.bias,
            self._window.config.imu.gravity_in_world,
            time_shift=self.residual_offset,
        )
        cameras = [pose.compose(body_T_cam) for pose in poses]
        for i, (_, frames, sightings) in enumerate(self._window.seen):
            seen_from = [cameras[frame] for frame in frames]
            points = compressed_points(sightings)
            try:
                found = triangulate_line(seen_from, points, self._window.sigma)
            except FactorError:
                continue
            self._charts[i] = found.chart
            self.values.update(LINES + i, np.zeros(4))
        after = self._built(FINE.chunk).line_errors(self.values)
        for i in np.flatnonzero(after > before - _BETTER).tolist():
            self._charts[i] = charts[i]
            self.values.update(LINES + i, values.atVector(LINES + i))

    # -- verdict ---------------------------------------------------------------------------------

    def misfits(self, sigma: float) -> list[FloatArray]:
        """See `BatchGraph.misfits`."""
        return self._graph.misfits(self.values, sigma)

    def state_covariance(self) -> FloatArray:
        """Of pose, velocity and bias at the window's start, (15, 15).

        See `batch_covariance.state_covariance`. The time offset counts as known: what it leaves
        open is for the window to find.

        Raises:
            RuntimeError, numpy.linalg.LinAlgError: when they are indeterminate.
        """
        keys = [POSE, VELOCITY, BIAS]
        if self._is_timed:
            keys.append(time_offset_key(self._window))
        linear = self._graph.factors.linearize(self.values)
        return state_covariance(linear, keys, fixed=int(self._is_timed))

    def velocities(self) -> list[tuple[FloatArray, FloatArray]]:
        """At the window's start and at its end, in the world, (3,), with covariances, (3, 3).

        Raises:
            RuntimeError, numpy.linalg.LinAlgError: when they are indeterminate.
        """
        covariance = self.state_covariance()
        R = self.pose.rotation().matrix()
        gained = self._graph.motion.corrected(self.bias.vector())[-1, 6:9]
        by_state = np.zeros((3, 15))
        by_state[:, :3] = -R @ gtsam.SO3.Hat(gained)
        by_state[:, 6:9] = np.eye(3)
        by_state[:, 9:] = R @ self._graph.motion.bias_jacobian[-1, 6:9]
        state = gtsam.NavState(self.pose, self.velocity)
        gravity = self._window.config.imu.gravity_in_world
        last = self._graph.motion.velocities(state, self.bias, gravity)[-1]
        return [
            (self.velocity, covariance[6:9, 6:9]),
            (last, by_state @ covariance @ by_state.T),
        ]
