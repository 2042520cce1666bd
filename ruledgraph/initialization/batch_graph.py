# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The factors of a first window: one state, whose motion the IMU gives, and all lines.

Keys: POSE, VELOCITY and BIAS of the state, LINES + i of line i, and after the lines the time
offset, where it is estimated.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.backend.line_factors import compressed_points
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.first_window import FirstWindow
from ruledgraph.initialization.prior import bias_sigmas, pose_covariance, unknown_offset
from ruledgraph.initialization.robust_line_factor import RobustLineFactor
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    FrameMotion,
    GeometricPoints,
    LineChart,
    RuledSurfaceFactor,
    ruled_surface_factor,
    ruled_surface_factor_with_time_offset,
)

POSE, VELOCITY, BIAS, LINES = 0, 1, 2, 3


class BatchGraph:
    """The nonlinear problem, with the motion linearised at a bias and the lines in their charts.

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
        self._window = window
        self._charts = charts
        offset = unknown_offset(window.config)
        self._time_offset_key = None if offset is None else time_offset_key(window)
        self.motion = window.motion(bias, with_time=offset is not None)
        self.factors = gtsam.NonlinearFactorGraph()
        self._of_lines: list[RobustLineFactor] = []
        self._add_state_priors(upright)
        if offset is not None:
            known = noiseModel.Isotropic.Sigma(1, offset.sigma)
            self.factors.addPriorDouble(time_offset_key(window), 0.0, known)
        self._add_lines(cauchy_px, chunk)

    def _add_state_priors(self, upright: gtsam.Rot3) -> None:
        start = self._window.config.start
        tilt = noiseModel.Gaussian.Covariance(pose_covariance(upright, start.tilt))
        self.factors.addPriorPose3(POSE, gtsam.Pose3(upright, np.zeros(3)), tilt)
        slow = noiseModel.Isotropic.Sigma(3, start.velocity)
        self.factors.addPriorVector(VELOCITY, np.zeros(3), slow)
        small = noiseModel.Diagonal.Sigmas(bias_sigmas(self._window.config))
        self.factors.addPriorConstantBias(BIAS, gtsam.imuBias.ConstantBias(), small)

    def _add_lines(self, cauchy_px: float, chunk: int) -> None:
        sigma, sigma_px = self._window.sigma, self._window.config.start.sigma_px
        wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
        for i, (_, frames, sightings) in enumerate(self._window.seen):
            self.factors.addPriorVector(LINES + i, np.zeros(4), wide)
            points = compressed_points(sightings)
            weights = np.add.reduceat(points.frame_weights, range(0, len(frames), chunk))
            surface = self._surface(i, self.motion.select(frames), points)
            scales = cauchy_px / sigma_px * np.sqrt(weights)
            factor = RobustLineFactor(surface, sigma, chunk, scales)
            self.factors.add(factor)
            self._of_lines.append(factor)

    def _surface(self, i: int, motion: FrameMotion, points: GeometricPoints) -> RuledSurfaceFactor:
        window, noise = self._window, noiseModel.Unit.Create(points.rows)
        gravity = window.config.imu.gravity_in_world
        rest = motion, self._charts[i], points, window.calibration.body_T_cam, gravity
        if self._time_offset_key is None:
            return ruled_surface_factor(noise, POSE, VELOCITY, BIAS, LINES + i, *rest)
        keys = POSE, VELOCITY, BIAS, self._time_offset_key, LINES + i
        return ruled_surface_factor_with_time_offset(noise, *keys, *rest)

    def line_errors(self, values: gtsam.Values) -> FloatArray:
        """Of each line, without its prior, (N,)."""
        return np.array([factor.error(values) for factor in self._of_lines])

    def misfits(self, values: gtsam.Values, sigma: float) -> list[FloatArray]:
        """How far each line's points are from its rulings, for each frame that saw it: the sum of
        their squared distances but for their scatter, over `sigma` squared.

        It has two degrees of freedom where `sigma` (normalised units) is a point's deviation.
        """
        found = []
        for factor in self._of_lines:
            residual = factor.surface.residual(values).reshape(-1, 3)
            found.append(np.sum(residual * residual, axis=1) / sigma**2)
        return found


def time_offset_key(window: FirstWindow) -> int:
    """Of the time offset."""
    return LINES + len(window.seen)
