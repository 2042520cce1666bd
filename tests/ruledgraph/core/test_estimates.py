# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
import gtsam
import numpy as np

from ruledgraph.core.estimates import Estimate


def estimate() -> Estimate:
    rng = np.random.default_rng(3)
    factors = [rng.normal(size=(n, n)) for n in (6, 3, 6)]
    pose, velocity, bias = (factor @ factor.T for factor in factors)
    return Estimate(
        stamp=1_500_000_000,
        world_T_body=gtsam.Pose3(gtsam.Rot3.RzRyRx(0.3, -0.2, 2.0), np.array([1.0, 2.0, 3.0])),
        velocity=np.array([0.1, 0.2, 0.3]),
        bias=gtsam.imuBias.ConstantBias(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])),
        covariances=(pose, velocity, bias),
        lines=7,
        status="tracking",
        at_state=True,
    )


def test_the_numbers_are_those_of_the_gtsam_objects():
    e = estimate()
    assert e.time == 1.5
    np.testing.assert_array_equal(e.matrix, e.world_T_body.matrix())
    np.testing.assert_array_equal(e.position, [1.0, 2.0, 3.0])
    x, y, z, w = e.quaternion_xyzw
    assert gtsam.Rot3.Quaternion(w, x, y, z).equals(e.world_T_body.rotation(), 1e-12)
    np.testing.assert_array_equal(e.accelerometer_bias, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(e.gyroscope_bias, [0.4, 0.5, 0.6])


def test_covariance_blocks_are_those_of_gtsams_tangent():
    e = estimate()
    pose, velocity, bias = e.covariances
    np.testing.assert_array_equal(e.pose_covariance, pose)
    np.testing.assert_array_equal(e.rotation_covariance, pose[:3, :3])
    np.testing.assert_array_equal(e.velocity_covariance, velocity)
    # GTSAM's bias is the accelerometer's, then the gyroscope's.
    np.testing.assert_array_equal(e.accelerometer_bias_covariance, bias[:3, :3])
    np.testing.assert_array_equal(e.gyroscope_bias_covariance, bias[3:, 3:])


def test_the_position_covariance_is_that_of_drawn_positions():
    e = estimate()
    J = np.empty((3, 6))
    for i, step in enumerate(np.eye(6) * 1e-6):
        moved = e.world_T_body.retract(step).translation()
        J[:, i] = (moved - e.position) / 1e-6
    # First order; what is left is the difference quotient's.
    np.testing.assert_allclose(e.position_covariance, J @ e.pose_covariance @ J.T, rtol=1e-4)
