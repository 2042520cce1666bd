# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Bad input of the preintegration: it is named."""

import numpy as np
import pytest

from ruledgraph_factors import FactorError, FrameMotion, ImuSamples, preintegrate_frames


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
        (lambda: preintegrate_frames(good_imu(), None, [0.1]), "node_time"),
        (lambda: preintegrate_frames(good_imu(), np.nan, [0.1]), "node_time has a NaN"),
        (lambda: preintegrate_frames(good_imu(), 0.05, [0.1], np.zeros(6)), "bias must be a Const"),
        (lambda: list(good_imu().segments(np.nan, 0.1)), "start has a NaN"),
        (lambda: FrameMotion.at_rest().select([0.9]), "frames must be indices, not float64"),
        (lambda: FrameMotion.at_rest().select([True]), "frames must be indices, not bool"),
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
