# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The batch problem of a first window: one state, whose motion the IMU gives, and all lines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.backend.line_factors import compressed_points
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph.initialization.closed_form import ClosedForm
from ruledgraph.initialization.prior import bias_sigmas, pose_covariance, unknown_offset
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    FactorError,
    FrameMotion,
    GeometricPoints,
    ImuSamples,
    LineChart,
    level_attitude,
    line_from_ruling,
    preintegrate_frames,
    ruled_surface_factor,
    ruled_surface_factor_with_time_offset,
    triangulate_line,
)

# Keys: pose, velocity, bias, the lines from here on, and the time offset after them.
_POSE, _VELOCITY, _BIAS, _LINES = 0, 1, 2, 3
_TOLERANCE = 1e-4
# The closed form's lines that come out nearer or further than this begin in between, m.
_NEAR, _FAR, _BETWEEN = 0.1, 50.0, 5.0
# A line is replaced by one that is triangulated anew when its error falls by more.
_BETTER = 1.0


class Effort(NamedTuple):
    """How thoroughly a batch is solved."""

    iterations: int
    chunk: int
    """Frames of a line that share one loss: a track that jumps does so for good."""


ROUGH, FINE = Effort(8, 6), Effort(15, 2)


class Seen(NamedTuple):
    """A line in a window."""

    track: LineTrack
    frames: list[int]
    """Which frames of the window saw it."""
    sightings: list[Sighting]


@dataclass(frozen=True, eq=False)
class FirstWindow:
    """What a start in motion is made from."""

    samples: ImuSamples
    times: list[float]
    """Of its frames, s."""
    seen: Sequence[Seen]
    calibration: Calibration
    config: Config

    @property
    def sigma(self) -> float:
        """Standard deviation of a point, normalised units."""
        return self.config.start.sigma_px / self.calibration.camera.focal_length


class Batch:
    """The batch problem from one initial value on.

    Variables: pose and velocity at the window's first frame, bias, a `LineChart` for each line and,
    when it is estimated, the time offset. The pose's position and yaw are fixed.
    """

    def __init__(self, window: FirstWindow, gyroscope_bias: FloatArray) -> None:
        self._window = window
        self._shift, self._shift_key = unknown_offset(window.config), _LINES + len(window.seen)
        bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyroscope_bias)
        motion = preintegrate_frames(window.samples, window.times[0], window.times, bias)
        self._motion = motion
        # Upright on average: what velocity was gained meanwhile is the error.
        self._upright = level_attitude(motion.preintegrated[-1, 6:9])
        self._charts: list[LineChart] = []
        self._factors: list[tuple[int, gtsam.NoiseModelFactor, GeometricPoints]] = []
        self.graph = gtsam.NonlinearFactorGraph()
        self.values = gtsam.Values()
        self.values.insert(_BIAS, bias)
        if self._shift is not None:
            self.values.insert(self._shift_key, 0.0)
        self._cauchy_px = np.inf
        self.error = np.inf

    @classmethod
    def at_distance(
        cls, window: FirstWindow, gyroscope_bias: FloatArray, distance: float
    ) -> "Batch":
        """From no velocity, and all lines so far away, m."""
        batch = cls(window, gyroscope_bias)
        batch._set_state(batch._upright, np.zeros(3))
        poses = batch._poses()
        for line in window.seen:
            anchor = gtsam.Pose3(poses[line.frames[0]].rotation(), np.zeros(3))
            world_T_cam = anchor.compose(window.calibration.body_T_cam)
            batch._add(line_from_ruling(world_T_cam, line.sightings[0].points, 1.0 / distance))
        return batch

    @classmethod
    def from_closed_form(
        cls, window: FirstWindow, gyroscope_bias: FloatArray, found: ClosedForm
    ) -> "Batch":
        """From the linear solution."""
        batch = cls(window, gyroscope_bias)
        up = gtsam.Unit3(-found.gravity)
        own_up = gtsam.Unit3(batch._upright.unrotate(np.array([0.0, 0.0, 1.0])))
        attitude = batch._upright.compose(_turn(up.point3(), own_up.point3()))
        batch._set_state(attitude, attitude.rotate(found.velocity))
        cameras = batch._cameras()
        for line, along, moment in zip(window.seen, found.directions, found.moments, strict=True):
            camera, points = cameras[line.frames[0]], line.sightings[0].points
            direction, moment = attitude.rotate(along), attitude.rotate(moment)
            # From the camera's centre to the line's next point, and along the ray to the line.
            foot = np.cross(direction, moment + np.cross(direction, camera.translation()))
            ray = camera.rotation().rotate(np.append(points.mean(axis=0), 1.0))
            depth = np.linalg.lstsq(np.column_stack([ray, -direction]), foot, rcond=None)[0][0]
            if _NEAR < depth < _FAR:
                through = np.cross(camera.translation() + foot, direction)
                batch._add(LineChart.from_plucker(camera, through, direction))
            else:
                batch._add(line_from_ruling(camera, points, 1.0 / _BETWEEN))
        return batch

    def _set_state(self, attitude: gtsam.Rot3, velocity: FloatArray) -> None:
        self.values.insert(_POSE, gtsam.Pose3(attitude, np.zeros(3)))
        self.values.insert(_VELOCITY, velocity)

    def _add(self, chart: LineChart) -> None:
        self.values.insert(_LINES + len(self._charts), np.zeros(4))
        self._charts.append(chart)

    # -- solution --------------------------------------------------------------------------------

    @property
    def pose(self) -> gtsam.Pose3:
        """world_T_body at the window's start."""
        return self.values.atPose3(_POSE)

    @property
    def velocity(self) -> FloatArray:
        """In the world, at the window's start, (3,), m/s."""
        return np.asarray(self.values.atVector(_VELOCITY))

    @property
    def bias(self) -> gtsam.imuBias.ConstantBias:
        """Of the IMU."""
        return self.values.atConstantBias(_BIAS)

    @property
    def time_shift(self) -> float:
        """How much later than their times the frames were taken, s."""
        return 0.0 if self._shift is None else float(self.values.atDouble(self._shift_key))

    def line(self, i: int) -> tuple[LineChart, FloatArray]:
        """Chart and delta of a line."""
        return self._charts[i], np.asarray(self.values.atVector(_LINES + i))

    def _poses(self) -> list[gtsam.Pose3]:
        state = gtsam.NavState(self.pose, self.velocity)
        return self._motion.poses(state, self.bias, time_shift=self.time_shift)

    def _cameras(self) -> list[gtsam.Pose3]:
        body_T_cam = self._window.calibration.body_T_cam
        return [pose.compose(body_T_cam) for pose in self._poses()]

    # -- solving ---------------------------------------------------------------------------------

    def solve(self, cauchy_px: float, effort: Effort = FINE) -> None:
        """Levenberg-Marquardt with that constant of the robust loss.

        Raises:
            RuntimeError: for a system that is indeterminate.
            FactorError: when a line comes out through its camera.
        """
        self._cauchy_px = cauchy_px
        self._build(cauchy_px, effort.chunk)
        params = gtsam.LevenbergMarquardtParams()
        params.setMaxIterations(effort.iterations)
        params.setRelativeErrorTol(_TOLERANCE)
        # The priors are stiff: damping has to follow the diagonal.
        params.setDiagonalDamping(True)
        params.setlambdaUpperBound(1e10)
        self.values = gtsam.LevenbergMarquardtOptimizer(self.graph, self.values, params).optimize()
        self.error = self.graph.error(self.values)

    def triangulate_anew(self) -> None:
        """Replace lines, stuck at a wrong distance or direction, that fit better when the motion
        found so far places them. Follows `solve`, whose loss it goes by.
        """
        self._build(self._cauchy_px, FINE.chunk)
        before, values, charts = self._errors(), gtsam.Values(self.values), list(self._charts)
        cameras = self._cameras()
        for i, (_, frames, sightings) in enumerate(self._window.seen):
            seen_from = [cameras[frame] for frame in frames]
            points = compressed_points(sightings)
            try:
                found = triangulate_line(seen_from, points, self._window.sigma)
            except FactorError:
                continue
            self._charts[i] = found.chart
            self.values.update(_LINES + i, np.zeros(4))
        self._build(self._cauchy_px, FINE.chunk)
        for i in np.flatnonzero(self._errors() > before - _BETTER).tolist():
            self._charts[i] = charts[i]
            self.values.update(_LINES + i, values.atVector(_LINES + i))

    def _errors(self) -> FloatArray:
        """Of each line."""
        errors = np.zeros(len(self._charts))
        for i, factor, _ in self._factors:
            errors[i] += factor.error(self.values)
        return errors

    def _build(self, cauchy_px: float, chunk: int) -> None:
        window, start = self._window, self._window.config.start
        timed = self._shift is not None
        self._motion = preintegrate_frames(
            window.samples, window.times[0], window.times, self.bias, with_time=timed
        )
        self.graph = graph = gtsam.NonlinearFactorGraph()
        upright = gtsam.Pose3(self._upright, np.zeros(3))
        tilt = noiseModel.Gaussian.Covariance(pose_covariance(self._upright, start.tilt))
        graph.addPriorPose3(_POSE, upright, tilt)
        graph.addPriorVector(_VELOCITY, np.zeros(3), noiseModel.Isotropic.Sigma(3, start.velocity))
        none = gtsam.imuBias.ConstantBias()
        graph.addPriorConstantBias(
            _BIAS, none, noiseModel.Diagonal.Sigmas(bias_sigmas(window.config))
        )
        if self._shift is not None:
            known = noiseModel.Isotropic.Sigma(1, self._shift.sigma)
            graph.addPriorDouble(self._shift_key, 0.0, known)
        wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
        self._factors = []
        for i, (_, frames, sightings) in enumerate(window.seen):
            graph.addPriorVector(_LINES + i, np.zeros(4), wide)
            for first in range(0, len(frames), chunk):
                part = slice(first, first + chunk)
                points = compressed_points(sightings[part])
                size = cauchy_px / start.sigma_px * np.sqrt(points.weight)
                noise = noiseModel.Robust.Create(
                    noiseModel.mEstimator.Cauchy.Create(size),
                    noiseModel.Isotropic.Sigma(points.rows, window.sigma),
                )
                factor = self._factor(i, noise, self._motion.select(frames[part]), points)
                graph.add(factor)
                self._factors.append((i, factor, points))

    def _factor(
        self, i: int, noise: noiseModel.Base, motion: FrameMotion, points: GeometricPoints
    ) -> gtsam.NoiseModelFactor:
        chart, body_T_cam = self._charts[i], self._window.calibration.body_T_cam
        line = _LINES + i
        if self._shift is None:
            return ruled_surface_factor(
                noise, _POSE, _VELOCITY, _BIAS, line, motion, chart, points, body_T_cam
            )
        return ruled_surface_factor_with_time_offset(
            noise,
            _POSE,
            _VELOCITY,
            _BIAS,
            self._shift_key,
            line,
            motion,
            chart,
            points,
            body_T_cam,
        )

    # -- verdict ---------------------------------------------------------------------------------

    def misfits(self, sigma: float) -> list[FloatArray]:
        """How far each line's points are from its rulings, for each frame that saw it: the sum of
        their squared distances less the scatter across their own best line, over `sigma` squared.

        It has two degrees of freedom where `sigma` (normalised units) is a point's deviation.
        """
        found: list[list[FloatArray]] = [[] for _ in self._charts]
        for i, factor, points in self._factors:
            residual = factor.unwhitenedError(self.values).reshape(-1, 3)
            squared = np.sum(residual * residual, axis=1) - _scatter(points.statistics)
            found[i].append(np.maximum(squared, 0.0) / sigma**2)
        return [np.concatenate(own) for own in found]

    def state_covariance(self) -> FloatArray:
        """Of pose, velocity and bias at the window's start, (15, 15).

        The time offset counts as known: what it leaves open is for the window to find.

        Raises:
            RuntimeError: when they are indeterminate.
        """
        marginals = gtsam.Marginals(self.graph, self.values)
        keys = [_POSE, _VELOCITY, _BIAS]
        if self._shift is None:
            return np.asarray(marginals.jointMarginalCovariance(keys).fullMatrix())
        information = marginals.jointMarginalInformation([*keys, self._shift_key]).fullMatrix()
        return np.asarray(np.linalg.inv(information[:15, :15]))

    def velocity_covariances(self) -> tuple[FloatArray, FloatArray]:
        """Of the velocity at the window's start and at its end, in the world, (3, 3) each."""
        covariance = self.state_covariance()
        R = self.pose.rotation().matrix()
        gained = self._motion.corrected(self.bias.vector())[-1, 6:9]
        by_state = np.zeros((3, 15))
        by_state[:, :3] = -R @ gtsam.SO3.Hat(gained)
        by_state[:, 6:9] = np.eye(3)
        by_state[:, 9:] = R @ self._motion.bias_jacobian[-1, 6:9]
        return covariance[6:9, 6:9], by_state @ covariance @ by_state.T


def _turn(one: FloatArray, other: FloatArray) -> gtsam.Rot3:
    """The shortest rotation that takes a unit vector onto another one."""
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, one @ other)
    return gtsam.Rot3.Expmap(axis * (angle / sine if sine > 0.0 else 0.0))


def _scatter(statistics: FloatArray) -> FloatArray:
    """Weighted sum of squares of points across their own best line, by frame, (n,).

    It is the least of |C l|^2 over all lines l = (n, -rho), |n| = 1: noise that says nothing of the
    motion. With p the weighted mean it is the smaller eigenvalue of sum w (x - p)(x - p)^T.
    """
    moments = np.einsum("nki,nkj->nij", statistics, statistics)
    mean = moments[:, :2, 2]
    centred = moments[:, :2, :2] - mean[:, :, None] * mean[:, None, :] / moments[:, 2:, 2:]
    return np.asarray(np.linalg.eigvalsh(centred)[:, 0])
