# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Gravity, velocity and biases to start from, at rest or in motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.backend.states import Start
from ruledgraph.backend.time_offset import TimeOffset
from ruledgraph.calibration.sensors import Calibration, FloatArray
from ruledgraph.core.config import Config
from ruledgraph.frontend.tracks import Sighting, Track, compressed_points
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    STANDARD_GRAVITY,
    FactorError,
    LineChart,
    level_attitude,
    line_from_ruling,
    preintegrate_frames,
    ruled_surface_factor,
    ruled_surface_factor_with_time_offset,
)

_G = -STANDARD_GRAVITY[2]
# At rest the gyroscope and the accelerometer hardly vary (rad/s, m/s^2), and the image does not
# move (px).
_STILL_GYROSCOPE, _STILL_ACCELEROMETER, _STILL_IMAGE = 0.02, 0.25, 0.4
# Distances a batch is started from, m, and its robust constants, round by round (px).
_DISTANCES = (1.0, 3.0)
# Of a point, px: wide, so that a start far off finds its way.
_DEVIATION = 1.0
_ROUNDS = (6.0, 2.0, 1.0)
# Frames of a line that share one loss, and the most frames used.
_CHUNK, _MOST_FRAMES = 4, 20
# What a start must reach: lines, share of them that fit (to so many px, root mean square),
# deviation of the velocity (m/s).
_FEWEST_LINES, _LEAST_FIT, _WORST_VELOCITY = 6, 0.7, 0.08
_FIT = 1.0
_TILT_SIGMA = 0.5
_VELOCITY_SIGMA = 3.0
# What is free to choose is held this tightly (rad, m).
_GAUGE = 1e-4


@dataclass(frozen=True)
class Refusal:
    """Why there is no start yet."""

    reason: str


def is_still(imu: ImuBuffer, start: float, stop: float, image_motion: Callable[[], float]) -> bool:
    """Whether body and image rest over [start, stop].

    Args:
        imu: samples that cover it.
        start: s.
        stop: s.
        image_motion: of the lines from start to stop, px, see `Tracker.image_motion`; asked for
            only where the IMU is still.
    """
    samples = imu.between(start, stop)
    return bool(
        samples.gyroscope.std(axis=0).max() < _STILL_GYROSCOPE
        and samples.accelerometer.std(axis=0).max() < _STILL_ACCELEROMETER
        and image_motion() < _STILL_IMAGE
    )


def start_at_rest(
    imu: ImuBuffer, stamp: int, start: float, stop: float, config: Config
) -> Start | Refusal:
    """Gravity from the mean specific force, gyroscope bias from the mean rate.

    Args:
        imu: samples that cover the rest.
        stamp: of the frame at its end, where the window begins, ns.
        start: of the rest, s.
        stop: of the rest, s.
        config: all settings.
    """
    samples = imu.between(start, stop)
    force = samples.accelerometer.mean(axis=0)
    if abs(np.linalg.norm(force) - _G) > 0.15 * _G:
        return Refusal(
            f"at rest the accelerometer shows {np.linalg.norm(force):.2f} instead of 9.81 m/s^2"
        )
    rate = samples.gyroscope.mean(axis=0)
    a = config.start.accelerometer_bias
    # The accelerometer's bias cannot be told from a tilt.
    tilt = a / _G
    attitude = level_attitude(force)
    return Start(
        stamp=stamp,
        time=stop,
        state=gtsam.NavState(attitude, np.zeros(3), np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(np.zeros(3), rate),
        pose_covariance=_pose_covariance(attitude, tilt),
        velocity_sigma=0.01,
        bias_sigmas=np.array([a, a, a, 2e-3, 2e-3, 2e-3]),
        lines={},
        time_offset=_open_offset(config),
    )


def start_in_motion(
    imu: ImuBuffer,
    stamps: Sequence[int],
    times: Sequence[float],
    tracks: Sequence[Track],
    calibration: Calibration,
    config: Config,
) -> Start | Refusal:
    """Everything from a first window of line tracks and IMU, starting from several distances.

    One batch problem: the state at the first frame, whose motion to the others is preintegrated,
    and all lines, with a robust loss that narrows. The best of the starts is taken if it explains
    its points.
    """
    step = max(1, -(-len(stamps) // _MOST_FRAMES))
    used = list(range(0, len(stamps), step))
    wanted = {stamps[i]: n for n, i in enumerate(used)}
    seen: list[tuple[Track, list[int], list[Sighting]]] = []
    for track in tracks:
        hits = [s for s in track.sightings if s.stamp in wanted]
        if len(hits) >= 0.5 * len(used):
            seen.append((track, [wanted[s.stamp] for s in hits], hits))
    if len(seen) < _FEWEST_LINES:
        return Refusal(f"{len(seen)} lines were followed long enough, {_FEWEST_LINES} are needed")
    best: _Batch | None = None
    for distance in _DISTANCES:
        batch = _Batch(imu, [times[i] for i in used], seen, calibration, config, distance)
        try:
            batch.solve()
        except (RuntimeError, FactorError):
            continue
        if best is None or batch.error < best.error:
            best = batch
    if best is None:
        return Refusal("no start converged")
    return best.start(stamps[0], times[0])


class _Batch:
    """One start of the batch problem."""

    def __init__(
        self,
        imu: ImuBuffer,
        times: list[float],
        seen: Sequence[tuple[Track, list[int], list[Sighting]]],
        calibration: Calibration,
        config: Config,
        distance: float,
    ) -> None:
        self._samples = imu.between(times[0], times[-1])
        self._times = times
        self._seen = seen
        self._calibration = calibration
        self._config = config
        self._focal = calibration.camera.focal_length
        self._deviation = _DEVIATION / self._focal
        self._shift, self._shift_key = _open_offset(config), 3 + len(seen)
        bias = gtsam.imuBias.ConstantBias()
        motion = preintegrate_frames(self._samples, times[0], times, bias)
        self._attitude = level_attitude(motion.preintegrated[-1, 6:9])
        self.values = gtsam.Values()
        self.values.insert(0, gtsam.Pose3(self._attitude, np.zeros(3)))
        self.values.insert(1, np.zeros(3))
        self.values.insert(2, bias)
        poses = motion.poses(gtsam.NavState(self._attitude, np.zeros(3), np.zeros(3)), bias)
        self._charts: list[LineChart] = []
        for i, (_, index, sightings) in enumerate(seen):
            anchor = gtsam.Pose3(poses[index[0]].rotation(), np.zeros(3))
            world_T_cam = anchor.compose(calibration.body_T_cam)
            chart = line_from_ruling(world_T_cam, sightings[0].points, 1.0 / distance)
            self._charts.append(chart)
            self.values.insert(3 + i, np.zeros(4))
        if self._shift is not None:
            self.values.insert(self._shift_key, 0.0)
        self.error = np.inf
        self.graph = gtsam.NonlinearFactorGraph()

    def solve(self) -> None:
        for robust in _ROUNDS:
            self.graph = self._build(robust)
            params = gtsam.LevenbergMarquardtParams()
            params.setMaxIterations(15)
            params.setRelativeErrorTol(1e-4)
            params.setDiagonalDamping(True)
            params.setlambdaUpperBound(1e10)
            self.values = gtsam.LevenbergMarquardtOptimizer(
                self.graph, self.values, params
            ).optimize()
        self.error = self.graph.error(self.values)

    def _build(self, robust: float) -> gtsam.NonlinearFactorGraph:
        bias, timed = self.values.atConstantBias(2), self._shift is not None
        motion = preintegrate_frames(
            self._samples, self._times[0], self._times, bias, with_time=timed
        )
        graph = gtsam.NonlinearFactorGraph()
        covariance = _pose_covariance(self._attitude, _TILT_SIGMA)
        graph.addPriorPose3(
            0, gtsam.Pose3(self._attitude, np.zeros(3)), noiseModel.Gaussian.Covariance(covariance)
        )
        graph.addPriorVector(1, np.zeros(3), noiseModel.Isotropic.Sigma(3, _VELOCITY_SIGMA))
        start = self._config.start
        sigmas = np.repeat([start.accelerometer_bias, start.gyroscope_bias], 3)
        graph.addPriorConstantBias(
            2, gtsam.imuBias.ConstantBias(), noiseModel.Diagonal.Sigmas(sigmas)
        )
        if self._shift is not None:
            known = noiseModel.Isotropic.Sigma(1, self._shift.sigma)
            graph.addPriorDouble(self._shift_key, 0.0, known)
        self._line_factors: list[tuple[int, gtsam.NoiseModelFactor, float]] = []
        wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
        for i, (_, index, sightings) in enumerate(self._seen):
            graph.addPriorVector(3 + i, np.zeros(4), wide)
            for first in range(0, len(index), _CHUNK):
                part = slice(first, first + _CHUNK)
                compressed = compressed_points(sightings[part])
                weight = compressed.weight
                size = robust / _DEVIATION
                noise = noiseModel.Robust.Create(
                    noiseModel.mEstimator.Cauchy.Create(size * np.sqrt(weight)),
                    noiseModel.Isotropic.Sigma(compressed.rows, self._deviation),
                )
                chart, body_T_cam = self._charts[i], self._calibration.body_T_cam
                rest = 3 + i, motion.select(index[part]), chart, compressed, body_T_cam
                factor = (
                    ruled_surface_factor_with_time_offset(noise, 0, 1, 2, self._shift_key, *rest)
                    if timed
                    else ruled_surface_factor(noise, 0, 1, 2, *rest)
                )
                graph.add(factor)
                self._line_factors.append((i, factor, weight))
        return graph

    def _velocity_covariance(self) -> FloatArray:
        """Given the time offset: what that leaves open is for the window to find."""
        marginals = gtsam.Marginals(self.graph, self.values)
        if self._shift is None:
            return np.asarray(marginals.marginalCovariance(1))
        information = marginals.jointMarginalInformation([1, self._shift_key]).fullMatrix()
        return np.asarray(np.linalg.inv(information[:3, :3]))

    def start(self, stamp: int, time: float) -> Start | Refusal:
        """Check the solution, and hand it over."""
        fits = np.array(
            [
                self._focal * np.linalg.norm(factor.unwhitenedError(self.values)) / np.sqrt(w)
                for _, factor, w in self._line_factors
            ]
        )
        share = float(np.mean(fits < _FIT))
        if share < _LEAST_FIT:
            return Refusal(f"only {100 * share:.0f} % of the lines fit a common motion")
        try:
            covariance = self._velocity_covariance()
            velocity_sigma = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        except RuntimeError:
            velocity_sigma = np.inf
        if not velocity_sigma < _WORST_VELOCITY:
            return Refusal(
                f"the velocity is left open by {velocity_sigma:.2g} m/s: too little motion across "
                "the lines"
            )
        lines = {}
        for i, (track, _, _) in enumerate(self._seen):
            delta = self.values.atVector(3 + i)
            own = fits[[n for n, (j, _, _) in enumerate(self._line_factors) if j == i]]
            if np.median(own) < _FIT and self._charts[i].inverse_distance(delta)[0] > 0.0:
                lines[track.number] = (self._charts[i], delta)
        if len(lines) < _FEWEST_LINES // 2:
            return Refusal(f"{len(lines)} lines come out in front of the camera")
        a, g = self._config.start.accelerometer_bias, self._config.start.gyroscope_bias
        pose, shift = self.values.atPose3(0), self._shift
        if shift is not None:
            # As wide as before: the window sees the same points again.
            shift = TimeOffset(self.values.atDouble(self._shift_key), shift.sigma)
        return Start(
            stamp=stamp,
            time=time,
            state=gtsam.NavState(pose, self.values.atVector(1)),
            bias=self.values.atConstantBias(2),
            pose_covariance=_pose_covariance(pose.rotation(), _TILT_SIGMA),
            velocity_sigma=_VELOCITY_SIGMA,
            bias_sigmas=np.array([a, a, a, g, g, g]),
            lines=lines,
            time_offset=shift,
        )


def _open_offset(config: Config) -> TimeOffset | None:
    """What is known of how much later than their times the frames were taken."""
    return TimeOffset(0.0, config.time_offset.sigma) if config.time_offset.estimate else None


def _pose_covariance(attitude: gtsam.Rot3, tilt: float) -> FloatArray:
    """Of a first pose, (6, 6): position and yaw are the world's choice, the tilt is not."""
    up = attitude.matrix().T @ np.array([0.0, 0.0, 1.0])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = tilt**2 * (np.eye(3) - np.outer(up, up)) + _GAUGE**2 * np.outer(up, up)
    covariance[3:, 3:] = _GAUGE**2 * np.eye(3)
    return covariance
