# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Bad input of the preintegration: it is named."""

import gtsam
import numpy as np
import pytest

from random_factors import random_case
from ruledgraph_factors import FactorError, FrameMotion, ImuSamples, preintegrate_frames
from ruledgraph_factors.factor import state_at


def good_imu() -> ImuSamples:
    return ImuSamples([0.0, 0.1, 0.2], np.zeros((3, 3)), np.zeros((3, 3)))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ImuSamples([0.0, 0.1, 0.1], np.zeros((3, 3)), np.zeros((3, 3))), "times must inc"),
        (lambda: ImuSamples([0.0], np.zeros((1, 3)), np.zeros((1, 3))), "times: at least two"),
        (lambda: ImuSamples([0.0, 1.0], np.zeros((3, 3)), np.zeros((2, 3))), "gyroscope must have"),
        (
            lambda: ImuSamples([0.0, 1.0], np.zeros((2, 3)), [[0, 0, 9.8], [0, np.nan, 9.8]]),
            r"accelerometer has a NaN or infinite value at \[1, 1\]",
        ),
        (lambda: preintegrate_frames(good_imu(), 0.05, [0.1, 0.1]), "frame_times must increase"),
        (lambda: preintegrate_frames(good_imu(), 0.05, []), "frame_times is empty"),
        (lambda: preintegrate_frames(good_imu(), 0.05, [0.01]), r"frame_times\[0\] = .* before"),
        (lambda: preintegrate_frames(good_imu(), 0.05, [0.3]), "IMU samples cover 0.0.* to 0.2"),
        (lambda: preintegrate_frames(None, 0.05, [0.1]), "imu must be a ImuSamples"),
        (lambda: preintegrate_frames(good_imu(), None, [0.1]), "state_time"),
        (lambda: preintegrate_frames(good_imu(), np.nan, [0.1]), "state_time has a NaN"),
        (lambda: preintegrate_frames(good_imu(), 0.05, [0.1], np.zeros(6)), "bias must be a Const"),
        (lambda: list(good_imu().segments(np.nan, 0.1)), "start has a NaN"),
        (lambda: FrameMotion.at_rest().select([0.9]), "frames must be indices, not float64"),
        (lambda: FrameMotion.at_rest().select([True]), "frames must be indices, not bool"),
        (lambda: FrameMotion.at_rest().select([]), "frames: none of the 1 frames is selected"),
        (lambda: FrameMotion.at_rest().select(slice(1, 9)), "frames: none of the 1 frames"),
        (lambda: FrameMotion.at_rest().select([1]), "frames: index 1 is out of bounds"),
        (lambda: list(good_imu().segments(0.1, 0.0)), "stop = .* before start"),
        (
            lambda: FrameMotion([-0.1], np.zeros((1, 9)), np.zeros((1, 9, 6)), np.zeros(6)),
            "elapsed",
        ),
        (
            lambda: FrameMotion([0.1], np.zeros((2, 9)), np.zeros((1, 9, 6)), np.zeros(6)),
            "preintegrated must have shape",
        ),
    ],
)
def test_bad_input_names_the_argument(call, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        call()


def test_a_shift_in_time_takes_a_motion_that_knows_it() -> None:
    motion = preintegrate_frames(good_imu(), 0.05, [0.1, 0.15])
    state, bias = gtsam.NavState(), gtsam.imuBias.ConstantBias()
    arrays = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(6), np.zeros(3)
    for call in (
        lambda shift: motion.poses(state, bias, time_shift=shift),
        lambda shift: motion.predict(*arrays, time_shift=shift),
        lambda shift: motion.corrected(np.zeros(6), shift),
    ):
        call(0.0)
        with pytest.raises(FactorError, match=r"time_shift is 0\.01 s, .* with_time=True"):
            call(0.01)


@pytest.mark.parametrize("kernel", ["numpy", "native"])
def test_a_factor_is_not_evaluated_at_a_shift_that_its_motion_does_not_know(
    kernel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RULEDGRAPH_KERNEL", kernel)
    case = random_case(0)
    for form, is_timed in (("node", False), ("node+time", True)):
        factor = case.factor(form)
        at = state_at(factor.spec, factor.keys(), case.values)._replace(time_shift=0.01)
        if is_timed:
            factor.evaluate(at, True)
            continue
        with pytest.raises(FactorError, match="with_time=True"):
            factor.evaluate(at, True)
