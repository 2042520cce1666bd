# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far the IMU is trusted from one state to the next."""

import gtsam
import numpy as np
import pytest

from ruledgraph.backend.imu_intervals import imu_interval
from ruledgraph.backend.self_calibration import AS_CALIBRATED, CameraVariables
from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.backend.time_offset import TimeOffsetVariable
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.synchronization.frame_history import FrameTime

TIMES = np.arange(0.0, 0.3001, 0.005)
SIGMA = 0.02


def turned(
    rate: np.ndarray,
    start: gtsam.Rot3,
    camera: CameraVariables = AS_CALIBRATED,
    still: bool = False,
) -> Interval:
    """A body that turns on the spot for 0.3 s."""
    imu = ImuBuffer()
    for time in TIMES.tolist():
        R = start.compose(gtsam.Rot3.Expmap(rate * time))
        # Readings that never change would be those of a frozen IMU.
        force = R.matrix().T @ -np.asarray(imu.gravity) + 1e-7 * time
        imu.append(time, rate, force)
    state = gtsam.NavState(gtsam.Pose3(start, np.zeros(3)), np.zeros(3))
    node = StateNode(0, 0.0, state, gtsam.imuBias.ConstantBias(), 1e-4 * np.eye(15))
    found, _ = imu_interval(
        node,
        [FrameTime(1, 0.15), FrameTime(2, 0.3)],
        False,
        imu,
        ADIS16448_LIKE,
        SIGMA,
        camera,
        still,
    )
    return found


def accelerometer_walk(interval: Interval) -> np.ndarray:
    """Covariance of the change of the accelerometer's bias, (3, 3)."""
    factor = interval.imu_factor
    return factor.preintegratedMeasurements().preintMeasCov()[9:12, 9:12]


@pytest.mark.parametrize(
    ("rate", "start", "gravity_turns"),
    [
        ([0.0, 0.0, 0.0], [0.3, 0.2, 0.1], 0.0),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 0.5], 0.0),
        ([1.0, 0.0, 0.0], [0.0, 0.0, 0.5], 0.3),
        ([0.6, -0.8, 0.0], [0.0, 0.0, 0.0], 0.3),
        ([0.0, 0.0, 1.0], [np.pi / 2, 0.0, 0.0], 0.3),
    ],
)
def test_the_accelerometers_bias_walks_by_what_gravity_turns_in_its_axes(
    rate, start, gravity_turns
):
    """By sigma |g' - g| beside the calibration's: the chord of the angle that g turns by."""
    interval = turned(np.array(rate), gtsam.Rot3.Expmap(np.array(start)))
    chord = 2.0 * 9.81 * np.sin(gravity_turns / 2.0)
    variance = ADIS16448_LIKE.accelerometer_walk**2 * TIMES[-1] + (SIGMA * chord) ** 2
    np.testing.assert_allclose(accelerometer_walk(interval), variance * np.eye(3), rtol=1e-3)


def test_scale_factors_are_within_it():
    """Over many IMUs whose readings are off by S f, S ~ N(0, sigma): the change of S f over the
    turn has that covariance.
    """
    rate, start = np.array([0.5, -0.9, 0.4]), gtsam.Rot3.Expmap(np.array([0.4, 0.2, -0.3]))
    covariance = accelerometer_walk(turned(rate, start))
    end = start.compose(gtsam.Rot3.Expmap(rate * TIMES[-1]))
    change = (end.matrix() - start.matrix()).T @ [0.0, 0.0, 9.81]
    scales = np.random.default_rng(0).normal(0.0, SIGMA, (20_000, 3, 3))
    of_scales = np.cov((scales @ change).T)
    walk = ADIS16448_LIKE.accelerometer_walk**2 * TIMES[-1] * np.eye(3)
    size = np.trace(of_scales) / 3.0
    # Variances of 20,000 are good to 1 %: five of these.
    np.testing.assert_allclose(covariance - walk, of_scales, atol=0.05 * size)


def test_frames_of_a_rest_are_not_shifted_in_time():
    camera = CameraVariables(TimeOffsetVariable(0, 0.0, 0.01, 1e-3, 0.0))
    for still, shift in ((False, 0.01), (True, 0.0)):
        interval = turned(np.array([0.0, 0.0, 1.0]), gtsam.Rot3(), camera, still)
        # Beside the first frame's 0.15 rad.
        assert interval.poses()[0].rotation().yaw() == pytest.approx(0.15 + shift, abs=1e-6)
        assert interval.state(np.zeros(4)).time_shift == shift
        assert interval.residual_offset == 0.01
