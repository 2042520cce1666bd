# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""From one state to the next by the IMU."""

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.states import Interval, Knot
from ruledgraph.backend.time_offset import OffsetLink
from ruledgraph.calibration.sensors import ImuNoise
from ruledgraph.imu.buffer import ImuBuffer, params_across
from ruledgraph_factors import preintegrate_frames


def imu_interval(
    knot: Knot,
    stamps: Sequence[int],
    times: Sequence[float],
    again: int,
    imu: ImuBuffer,
    noise: ImuNoise,
    link: OffsetLink | None,
    still: bool,
) -> tuple[Interval, Knot]:
    """The frames after a state with their motion, and the state at the last of them.

    Args:
        knot: the state before.
        stamps: of the frames, ns.
        times: of the frames, s.
        again: 1 when the first of them is the state's own.
        imu: samples that cover them.
        noise: of the IMU.
        link: the time offset of the frames, when that is estimated.
        still: whether the body rested all the time.
    """
    params, known = noise.preintegration_params(), len(times)
    doubts = imu.doubts(knot.time, times[-1])
    if doubts:
        params = params_across(noise, doubts, knot.time, times[-1])
        first = min(doubt.start for doubt in doubts)
        known = max(again, sum(time <= first for time in times))
    samples = imu.between(knot.time, times[-1])
    preintegrated = gtsam.PreintegratedCombinedMeasurements(params, knot.bias)
    for segment in samples.segments(knot.time, times[-1], at=times, bias=knot.bias):
        preintegrated.integrateMeasurement(*segment)
    if still:
        state = gtsam.NavState(knot.state.pose(), np.zeros(3))
    else:
        state = preintegrated.predict(knot.state, knot.bias)
    k = knot.index
    factor = gtsam.CombinedImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1), preintegrated)
    # At rest the noise of the gyroscope would feign knowledge of the offset.
    timed = link is not None and not still
    motion = preintegrate_frames(samples, knot.time, times, knot.bias, with_time=timed)
    interval = Interval(knot, list(stamps), motion, [factor], known, again, link, still)
    return interval, Knot(k + 1, times[-1], state, knot.bias, knot.covariance)
