# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""From one state to the next by the IMU."""

import math
from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.self_calibration import CameraVariables
from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import StartConfig
from ruledgraph.imu.buffer import ImuBuffer, params_across
from ruledgraph.synchronization.frame_history import FrameTime
from ruledgraph_factors import FrameMotion, ImuSamples, preintegrate_frames


def imu_interval(
    node: StateNode,
    frames: Sequence[FrameTime],
    repeats_frame: bool,
    imu: ImuBuffer,
    noise: ImuNoise,
    scale_sigma: float,
    camera: CameraVariables,
    still: bool,
) -> tuple[Interval, StateNode]:
    """The frames after a state with their motion, and the state at the last of them.

    Args:
        node: the state before.
        frames: that follow it.
        repeats_frame: whether the first of them is the state's own.
        imu: samples that cover them.
        noise: of the IMU.
        scale_sigma: the setting `imu.accelerometer_scale_sigma`.
        camera: what is estimated of the camera in these frames.
        still: whether the body rested all the time.
    """
    times = [frame.time for frame in frames]
    samples = imu.between(node.time, times[-1])
    # At rest the noise of the gyroscope would make the offset look observable.
    timed = camera.time_offset is not None and not still
    motion = preintegrate_frames(samples, node.time, times, node.bias, with_time=timed)
    noise = _with_scale_errors(noise, node, motion, imu.gravity, scale_sigma)
    params, reliable_frames = noise.preintegration_params(imu.gravity), len(times)
    unreliable = imu.unreliable(node.time, times[-1])
    if unreliable:
        params = params_across(noise, imu.gravity, unreliable, node.time, times[-1])
        first = min(interval.start for interval in unreliable)
        reliable_frames = max(int(repeats_frame), sum(time <= first for time in times))
    preintegrated = _preintegrated(node, times, samples, params)
    if still:
        state = gtsam.NavState(node.state.pose(), np.zeros(3))
    else:
        state = preintegrated.predict(node.state, node.bias)
    interval = Interval(
        node,
        [frame.stamp for frame in frames],
        motion,
        imu.gravity,
        noise,
        _factor(node, preintegrated),
        reliable_frames,
        repeats_frame,
        camera=camera,
        still=still,
    )
    return interval, StateNode(node.index + 1, times[-1], state, node.bias, node.covariance)


def add_bias_jump(
    interval: Interval,
    new: StateNode,
    jump: FloatArray,
    imu: ImuBuffer,
    noise: ImuNoise,
    config: StartConfig,
) -> None:
    """The biases jump at any time in an interval, by as much as they are unknown before a
    start: that much the mean of its samples may be off (white noise), and the biases at its end
    differ from those before (random walk). The state at its end is predicted with the jump.

    Its frames are guesses then: a line's factor knows the biases before the jump alone.

    Args:
        interval: with its IMU factor, which is replaced.
        new: the state at its end, which is replaced.
        jump: of accelerometer and gyroscope, (6,).
        imu: samples that cover it.
        noise: of the IMU.
        config: what is known of biases before a start.
    """
    node = interval.node
    root = math.sqrt(new.time - node.time)
    jumping = replace(
        noise,
        accelerometer=math.hypot(noise.accelerometer, config.accelerometer_bias * root),
        gyroscope=math.hypot(noise.gyroscope, config.gyroscope_bias * root),
        accelerometer_walk=config.accelerometer_bias / root,
        gyroscope_walk=config.gyroscope_bias / root,
    )
    interval.noise = jumping
    params = jumping.preintegration_params(imu.gravity)
    times = (node.time + interval.motion.elapsed).tolist()
    preintegrated = _preintegrated(node, times, imu.between(node.time, new.time), params)
    interval.imu_factor = _factor(node, preintegrated)
    interval.reliable_frames = int(interval.repeats_frame)
    changed = node.bias.vector() + jump
    new.bias = gtsam.imuBias.ConstantBias(changed[:3], changed[3:])
    if not interval.still:
        new.state = preintegrated.predict(node.state, new.bias)


def _with_scale_errors(
    noise: ImuNoise, node: StateNode, motion: FrameMotion, gravity: FloatArray, sigma: float
) -> ImuNoise:
    """Add to the random walk of the accelerometer's bias what scale errors do as the body turns.

    With scale factors and misalignment S the accelerometer is off by S f beside its bias. While the
    body turns from R to R' gravity changes this by S (R'^T - R^T) g, per axis with a standard
    deviation of `sigma` |(R'^T - R^T) g|.
    """
    before = node.state.pose().rotation().matrix().T @ gravity
    after = gtsam.Rot3.Expmap(-motion.preintegrated[-1, :3]).rotate(before)
    change = sigma * float(np.linalg.norm(after - before))
    per_root_second = change / math.sqrt(motion.elapsed[-1])
    return replace(noise, accelerometer_walk=math.hypot(noise.accelerometer_walk, per_root_second))


def _preintegrated(
    node: StateNode,
    times: Sequence[float],
    samples: ImuSamples,
    params: gtsam.PreintegrationCombinedParams,
) -> gtsam.PreintegratedCombinedMeasurements:
    preintegrated = gtsam.PreintegratedCombinedMeasurements(params, node.bias)
    for segment in samples.segments(node.time, times[-1], at=times, bias=node.bias):
        preintegrated.integrateMeasurement(*segment)
    return preintegrated


def _factor(
    node: StateNode, preintegrated: gtsam.PreintegratedCombinedMeasurements
) -> gtsam.CombinedImuFactor:
    k = node.index
    return gtsam.CombinedImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1), preintegrated)
