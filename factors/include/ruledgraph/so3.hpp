// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// SO(3) for single rotation vectors, as `ruledgraph_factors/so3.py` for stacks of them: the same
// formulas, the same limits between closed form and series. Conventions are GTSAM's:
// Exp(theta + d) = Exp(theta) Exp(Jr(theta) d).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace ruledgraph {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;

/// Cross-product matrix [v]x: [v]x w is v x w.
inline Matrix3 hat(const Vector3& v) {
  Matrix3 result;
  result << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return result;
}

/// The alternating series 1 - s/d1 (1 - s/d2 (1 - ...)) of five terms.
inline double alternating_series(double s, double d1, double d2, double d3, double d4, double d5) {
  return 1.0 - s / d1 * (1.0 - s / d2 * (1.0 - s / d3 * (1.0 - s / d4 * (1.0 - s / d5))));
}

struct Exponential {
  Matrix3 rotation;
  Matrix3 right_jacobian;
};

/// Exp = I + a K + b K^2 and Jr = I - b K + c K^2 with K = [theta]x, a = sin(t)/t,
/// b = (1 - cos t)/t^2, c = (t - sin t)/t^3.
inline Exponential exponential(const Vector3& theta) {
  const double s = theta.squaredNorm();
  double a, b, c;
  if (s < 0.3 * 0.3) {  // the closed forms lose digits to cancellation
    a = alternating_series(s, 6.0, 20.0, 42.0, 72.0, 110.0);
    b = 0.5 * alternating_series(s, 12.0, 30.0, 56.0, 90.0, 132.0);
    c = alternating_series(s, 20.0, 42.0, 72.0, 110.0, 156.0) / 6.0;
  } else {
    const double t = std::sqrt(s);
    a = std::sin(t) / t;
    b = (1.0 - std::cos(t)) / s;
    c = (1.0 - a) / s;
  }
  const Matrix3 k = hat(theta);
  const Matrix3 k2 = theta * theta.transpose() - s * Matrix3::Identity();
  return {Matrix3::Identity() + a * k + b * k2, Matrix3::Identity() - b * k + c * k2};
}

/// The rotation closest to a matrix that is one but for rounding, by one Newton step.
inline Matrix3 closest_rotation(const Matrix3& matrix) {
  return 1.5 * matrix - 0.5 * (matrix * (matrix.transpose() * matrix));
}

/// The rotation vector theta with Exp(theta) = rotation and |theta| <= pi.
inline Vector3 logarithm(const Matrix3& rotation) {
  const Eigen::Quaterniond q(rotation);
  const double size = q.vec().norm();
  if (size == 0.0) return Vector3::Zero();
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  return (sign * 2.0 * std::atan2(size, std::abs(q.w())) / size) * q.vec();
}

struct InverseRightJacobianAction {
  Vector3 value;    ///< Jr(theta)^-1 w
  Matrix3 inverse;  ///< Jr(theta)^-1, its derivative by w
  Matrix3 d_theta;  ///< its derivative by theta
};

/// Jr(theta)^-1 w with Jr^-1 = I + K/2 + c K^2, c(t) = 1/t^2 - cot(t/2)/(2t), for angles below 2
/// pi.
inline InverseRightJacobianAction inverse_right_jacobian_action(const Vector3& theta,
                                                                const Vector3& w) {
  const double s = theta.squaredNorm();
  const double t = std::sqrt(s);
  double c, slope;  // slope = c'(t)/t
  if (t < 0.5) {
    // Coefficients are |B_2k|/(2k)!, B the Bernoulli numbers.
    c = 1.0 / 12 + s * (1.0 / 720 + s * (1.0 / 30240 +
                                         s * (1.0 / 1209600 +
                                              s * (1.0 / 47900160 + s * 691.0 / 1307674368000.0))));
    slope = 1.0 / 360 + s * (1.0 / 7560 +
                             s * (1.0 / 201600 + s * (1.0 / 5987520 + s * 691.0 / 130767436800.0)));
  } else {
    const double sine = std::sin(t / 2.0);
    const double cotangent = std::cos(t / 2.0) / sine;
    c = 1.0 / s - cotangent / (2.0 * t);
    slope = -2.0 / (s * s) + cotangent / (2.0 * s * t) + 1.0 / (4.0 * s * sine * sine);
  }
  const Matrix3 k = hat(theta);
  const Matrix3 inverse = Matrix3::Identity() + 0.5 * k + c * (k * k);
  const double dot = theta.dot(w);
  const Vector3 double_cross = theta * dot - w * s;
  const Matrix3 outer = theta * w.transpose();
  const Matrix3 d_double_cross = dot * Matrix3::Identity() + outer - 2.0 * outer.transpose();
  return {inverse * w, inverse,
          -0.5 * hat(w) + double_cross * (slope * theta).transpose() + c * d_double_cross};
}

}  // namespace ruledgraph
