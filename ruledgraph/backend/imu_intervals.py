# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""From one state to the next by the IMU."""

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.extrinsics import ExtrinsicsState
from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.backend.time_offset import TimeOffsetState
from ruledgraph.calibration.sensors import ImuNoise
from ruledgraph.imu.buffer import ImuBuffer, params_across
from ruledgraph_factors import preintegrate_frames


def imu_interval(
    node: StateNode,
    stamps: Sequence[int],
    times: Sequence[float],
    repeats_frame: bool,
    imu: ImuBuffer,
    noise: ImuNoise,
    time_offset: TimeOffsetState | None,
    extrinsics: ExtrinsicsState | None,
    still: bool,
) -> tuple[Interval, StateNode]:
    """The frames after a state with their motion, and the state at the last of them.

    Args:
        node: the state before.
        stamps: of the frames, ns.
        times: of the frames, s.
        repeats_frame: whether the first of them is the state's own.
        imu: samples that cover them.
        noise: of the IMU.
        time_offset: the time offset of the frames, when that is estimated.
        extrinsics: the camera's pose in the body, when that is estimated.
        still: whether the body rested all the time.
    """
    params, reliable_frames = noise.preintegration_params(imu.gravity), len(times)
    unreliable = imu.unreliable(node.time, times[-1])
    if unreliable:
        params = params_across(noise, imu.gravity, unreliable, node.time, times[-1])
        first = min(interval.start for interval in unreliable)
        reliable_frames = max(int(repeats_frame), sum(time <= first for time in times))
    samples = imu.between(node.time, times[-1])
    preintegrated = gtsam.PreintegratedCombinedMeasurements(params, node.bias)
    for segment in samples.segments(node.time, times[-1], at=times, bias=node.bias):
        preintegrated.integrateMeasurement(*segment)
    if still:
        state = gtsam.NavState(node.state.pose(), np.zeros(3))
    else:
        state = preintegrated.predict(node.state, node.bias)
    k = node.index
    factor = gtsam.CombinedImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1), preintegrated)
    # At rest the noise of the gyroscope would make the offset look observable.
    timed = time_offset is not None and not still
    motion = preintegrate_frames(samples, node.time, times, node.bias, with_time=timed)
    interval = Interval(
        node,
        list(stamps),
        motion,
        imu.gravity,
        [factor],
        reliable_frames,
        repeats_frame,
        time_offset,
        extrinsics,
        still,
    )
    return interval, StateNode(k + 1, times[-1], state, node.bias, node.covariance)
