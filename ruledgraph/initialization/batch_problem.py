# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The least-squares problem of a first window: one state, whose motion the IMU gives, all lines."""

from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.bordered_system import BorderedSystem
from ruledgraph.initialization.first_window import FirstWindow
from ruledgraph.initialization.prior import pose_covariance
from ruledgraph_factors import NEW_LINE_SIGMAS, LineChart, RuledSurfaceSpec, State
from ruledgraph_factors.robust_lines import RobustLines

POSE, VELOCITY, BIAS, TIME = range(4)
_LINE_PRIOR = np.array(NEW_LINE_SIGMAS) ** -2.0


class Estimate(NamedTuple):
    """Where a batch stands."""

    state: gtsam.Values
    """Of POSE, VELOCITY, BIAS and, where it is estimated, TIME: how much later than their times the
    frames were taken, s."""
    deltas: FloatArray
    """Of the lines in their charts, (N, 4)."""

    def moved(self, by_state: FloatArray, by_lines: FloatArray) -> "Estimate":
        """By a step in the tangent space."""
        step, first = gtsam.VectorValues(), 0
        for key, size in (POSE, 6), (VELOCITY, 3), (BIAS, 6), (TIME, 1):
            if self.state.exists(key):
                step.insert(key, by_state[first : first + size])
                first += size
        return Estimate(self.state.retract(step), self.deltas + by_lines)


class BatchProblem:
    """The motion is linearised at a bias and the lines in their charts.

    Args:
        window: frames, lines and IMU.
        upright: world_R_body at the first frame by the accelerometer alone.
        bias: at which the IMU's motion is computed.
        charts: of the lines.
        cauchy_px: constant of the robust loss, px.
        chunk: frames of a line that share one loss.
    """

    def __init__(
        self,
        window: FirstWindow,
        upright: gtsam.Rot3,
        bias: gtsam.imuBias.ConstantBias,
        charts: Sequence[LineChart],
        cauchy_px: float,
        chunk: int,
    ) -> None:
        self._gravity = window.config.imu.gravity_in_world
        offset = window.time_offset
        self.motion = window.motion(bias, with_time=offset is not None)
        self._priors = gtsam.NonlinearFactorGraph()
        tilt = noiseModel.Gaussian.Covariance(pose_covariance(upright, window.config.start.tilt))
        self._priors.addPriorPose3(POSE, gtsam.Pose3(upright, np.zeros(3)), tilt)
        slow = noiseModel.Isotropic.Sigma(3, window.config.start.velocity)
        self._priors.addPriorVector(VELOCITY, np.zeros(3), slow)
        small = noiseModel.Diagonal.Sigmas(window.config.start.bias_sigmas)
        self._priors.addPriorConstantBias(BIAS, gtsam.imuBias.ConstantBias(), small)
        if offset is not None:
            known = noiseModel.Isotropic.Sigma(1, offset.sigma)
            self._priors.addPriorDouble(TIME, 0.0, known)
        self._order = gtsam.Ordering()
        for key in range(3 if offset is None else 4):
            self._order.push_back(key)
        self._lines = self._robust_lines(window, charts, cauchy_px, chunk)

    def _robust_lines(
        self, window: FirstWindow, charts: Sequence[LineChart], cauchy_px: float, chunk: int
    ) -> RobustLines:
        surfaces, scales = [], []
        timed = self._order.size() > TIME
        for chart, line, points in zip(charts, window.seen, window.points, strict=True):
            surface = RuledSurfaceSpec(
                form="node",
                camera_variables=("time",) if timed else (),
                keys=(POSE, VELOCITY, BIAS, TIME, TIME + 1) if timed else tuple(range(4)),
                noise_model=noiseModel.Unit.Create(points.rows),
                chart=chart,
                motion=self.motion.select(line.frames),
                points=points,
                body_T_cam=window.calibration.body_T_cam,
                gravity=self._gravity,
            )
            surfaces.append(surface)
            weights = np.add.reduceat(points.frame_weights, range(0, points.frames, chunk))
            scales.append(cauchy_px / window.config.edges.sigma_px * np.sqrt(weights))
        return RobustLines(surfaces, window.sigma, chunk, scales)

    def cost(self, at: Estimate) -> float:
        """Half the sum of squares, with the robust losses in place of the lines'."""
        priors = self._priors.error(at.state) + 0.5 * np.sum(np.square(at.deltas) @ _LINE_PRIOR)
        return float(priors + np.sum(self.line_losses(at)))

    def line_losses(self, at: Estimate) -> FloatArray:
        """Of each line, without its prior, (N,)."""
        return self._lines.losses(self._factor_state(at), at.deltas)

    def linearize(self, at: Estimate) -> BorderedSystem:
        """The normal equations there."""
        lines = self._lines.equations(self._factor_state(at), at.deltas)
        information, gradient = self._priors.linearize(at.state).hessian(self._order)
        information_of_lines, gradient_of_lines = lines.information, lines.gradient
        information_of_lines[:, -4:, -4:] += np.diag(_LINE_PRIOR)
        gradient_of_lines[:, -4:] += _LINE_PRIOR * at.deltas
        return BorderedSystem(information, -gradient, information_of_lines, gradient_of_lines)

    def misfits(self, at: Estimate, sigma: float) -> list[FloatArray]:
        """How far each line's points are from its rulings, for each frame that saw it: the sum of
        their squared distances but for their scatter, over `sigma` squared.

        It has two degrees of freedom where `sigma` (normalised units) is a point's deviation.
        """
        found = self._lines.squared_distances(self._factor_state(at), at.deltas)
        return [squares / sigma**2 for squares in found]

    def _factor_state(self, at: Estimate) -> State:
        state = at.state
        return State(
            state.atPose3(POSE).matrix(),
            state.atVector(VELOCITY),
            state.atConstantBias(BIAS).vector(),
            self._gravity,
            np.zeros(4),
            state.atDouble(TIME) if state.exists(TIME) else 0.0,
        )
