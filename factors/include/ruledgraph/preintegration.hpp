// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Tangent-space preintegration of the IMU with its derivative by the bias: the native version of
// `_integrate` in `ruledgraph_factors/integration.py`, where the equations are.
#pragma once

#include <Eigen/Core>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

/// Motion since a knot in the knot's body frame, and its derivative by the bias.
struct Preintegrated {
  /// (theta, dp, dv).
  Eigen::Matrix<double, 9, 1> delta = Eigen::Matrix<double, 9, 1>::Zero();
  /// By the bias (accelerometer, gyroscope).
  Eigen::Matrix<double, 9, 6> d_bias = Eigen::Matrix<double, 9, 6>::Zero();

  /// One Euler step of `dt` s; force (m/s^2) and rate (rad/s) are constant in it and without bias.
  void integrate(const Vector3& force, const Vector3& rate, double dt) {
    const Exponential turn = exponential(delta.head<3>());
    const InverseRightJacobianAction spin = inverse_right_jacobian_action(delta.head<3>(), rate);
    const Vector3 acceleration = turn.rotation * force;

    const Eigen::Matrix<double, 3, 6> d_theta = d_bias.topRows<3>();
    Eigen::Matrix<double, 3, 6> d_acceleration =
        -(turn.rotation * hat(force) * turn.right_jacobian) * d_theta;
    d_acceleration.leftCols<3>() -= turn.rotation;
    Eigen::Matrix<double, 3, 6> d_rate = spin.d_theta * d_theta;
    d_rate.rightCols<3>() -= spin.inverse;

    // The position takes the velocity before the step, hence this order.
    delta.head<3>() += spin.value * dt;
    delta.segment<3>(3) += delta.tail<3>() * dt + acceleration * (0.5 * dt * dt);
    delta.tail<3>() += acceleration * dt;
    d_bias.topRows<3>() += d_rate * dt;
    d_bias.middleRows<3>(3) += d_bias.bottomRows<3>() * dt + d_acceleration * (0.5 * dt * dt);
    d_bias.bottomRows<3>() += d_acceleration * dt;
  }
};

}  // namespace ruledgraph
