# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The motion that a real IMU felt: its samples integrated, and held to a measured trajectory.

A curve through the measured poses alone does not do for views that go with recorded samples. Of a
flight, one with knots 0.1 s apart turns from frame to frame by 0.05 degrees (RMS) otherwise than
the gyroscope: four times what an image tells.
"""

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, V, X
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.simulation.motion import SplineMotion
from ruledgraph_factors import ImuSamples

# How well laser trackers and motion capture know poses, m and rad. Their errors stay for a while:
# of all poses, so many a second count.
_POSITION_SIGMA, _ROTATION_SIGMA, _POSES_A_SECOND = 2e-3, 3e-3, 5.0
# Textbook constant of Huber's loss, 95 % efficient: trackers jump.
_HUBER = 1.345
# The bias is constant for so long, s, and within these, m/s^2 and rad/s.
_BIAS_TIME, _BIAS_SIGMAS = 1.0, np.repeat([1.0, 0.2], 3)


class InertialMotion(SplineMotion):
    """world_T_body(t) that explains an IMU's samples and is close to measured poses.

    Maximum a posteriori of pose and velocity at every sample and of the bias every second, given
    the samples with their noise and the poses with theirs; between them splines.

    Args:
        measured: poses.
        stamps: of the samples, within the measured ones, ns, (N,), N >= 6.
        samples: the IMU's, (N,), times in s from the first stamp.
        noise: of the IMU.
    """

    def __init__(
        self,
        measured: Trajectory,
        stamps: NDArray[np.int64],
        samples: ImuSamples,
        noise: ImuNoise,
    ) -> None:
        graph = _imu_factors(samples, noise)
        _add_measured(graph, measured, stamps)
        values = gtsam.LevenbergMarquardtOptimizer(graph, _initial(measured, stamps)).optimize()
        poses = [values.atPose3(X(k)) for k in range(stamps.size)]
        found = Trajectory.from_poses(stamps, poses)
        turns = Rotation.from_quat(found.quaternions).as_rotvec()
        super().__init__(samples.times, found.positions, turns)
        self.epoch = int(stamps[0])
        """Stamp of time zero, ns."""
        count = _bias_index(samples.times)[-1] + 1
        self.bias: FloatArray = np.array(
            [values.atConstantBias(B(n)).vector() for n in range(count)]
        )
        """Of the IMU: accelerometer and gyroscope, (M, 6), each for a second."""
        self.bias_stamps = stamps[0] + np.round(
            (np.arange(len(self.bias)) + 0.5) * _BIAS_TIME * 1e9
        ).astype(np.int64)
        """The middle of these seconds, ns, (M,)."""


def _bias_index(times: FloatArray) -> NDArray[np.int64]:
    return np.asarray(times // _BIAS_TIME, dtype=np.int64)


def _imu_factors(samples: ImuSamples, noise: ImuNoise) -> gtsam.NonlinearFactorGraph:
    graph, params = gtsam.NonlinearFactorGraph(), noise.preintegration_params()
    index = _bias_index(samples.times).tolist()
    segments = samples.segments(float(samples.times[0]), float(samples.times[-1]))
    for k, segment in enumerate(segments):
        step = gtsam.PreintegratedImuMeasurements(params)
        step.integrateMeasurement(*segment)
        graph.add(gtsam.ImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(index[k]), step))
    walk = np.repeat([noise.accelerometer_walk, noise.gyroscope_walk], 3) * np.sqrt(_BIAS_TIME)
    for n in range(index[-1]):
        drift = noiseModel.Diagonal.Sigmas(walk)
        graph.add(
            gtsam.BetweenFactorConstantBias(B(n), B(n + 1), gtsam.imuBias.ConstantBias(), drift)
        )
    first = noiseModel.Diagonal.Sigmas(_BIAS_SIGMAS)
    graph.addPriorConstantBias(B(0), gtsam.imuBias.ConstantBias(), first)
    return graph


def _add_measured(
    graph: gtsam.NonlinearFactorGraph, measured: Trajectory, stamps: NDArray[np.int64]
) -> None:
    """Priors at the samples that are the nearest to measured poses."""
    sigmas = noiseModel.Diagonal.Sigmas(np.repeat([_ROTATION_SIGMA, _POSITION_SIGMA], 3))
    robust = noiseModel.Robust.Create(noiseModel.mEstimator.Huber.Create(_HUBER), sigmas)
    middles = stamps[:-1] + np.diff(stamps) // 2
    nearest = np.unique(np.searchsorted(middles, measured.stamps))
    moments = (stamps[nearest] - stamps[0]) * 1e-9
    # One of each part of a second.
    _, first = np.unique(np.floor(moments * _POSES_A_SECOND + 0.5), return_index=True)
    chosen = nearest[first]
    for k, pose in zip(chosen.tolist(), measured.at(stamps[chosen]).poses(), strict=True):
        graph.addPriorPose3(X(k), pose, robust)


def _initial(measured: Trajectory, stamps: NDArray[np.int64]) -> gtsam.Values:
    values, at = gtsam.Values(), measured.at(stamps)
    times = (stamps - stamps[0]) * 1e-9
    velocities = np.gradient(at.positions, times, axis=0)
    for k, (pose, velocity) in enumerate(zip(at.poses(), velocities, strict=True)):
        values.insert(X(k), pose)
        values.insert(V(k), velocity)
    for n in range(_bias_index(times)[-1] + 1):
        values.insert(B(n), gtsam.imuBias.ConstantBias())
    return values
