// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// What one image does not show of a line; needs Eigen alone. The native version of
// `new_line_in_numpy` in `ruledgraph_factors/new_line.py`, which says what is computed.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

constexpr double kStraight = 0.05;
constexpr double kLeast = 1e-12;

/// What is expected of a line as seen from a pose.
struct ExpectedLine {
  Vector3 along, across;  ///< the reference's direction and its perpendicular in the plane; body
  double log_distance;
};

/// Residual, (log distance, angle in the plane), and its derivatives.
struct NewLine {
  Eigen::Vector2d value;
  Eigen::Matrix<double, 2, 6> by_pose;
  Eigen::Matrix<double, 2, 4> by_line;
};

inline NewLine new_line(const LineChart& chart, const Eigen::Vector4d& line,
                        const Matrix3& world_R_body, const Vector3& position,
                        const ExpectedLine& expected) {
  const PlueckerPair pair = plucker(chart, line);
  const Vector3 direction = pair.value.tail<3>();
  const Matrix3 from_pose = hat(position);
  const Vector3 moment = pair.value.head<3>() - from_pose * direction;
  const double size = std::max(moment.norm(), kLeast);
  const double sine = std::sin(chart.angle + line[0]), cosine = std::cos(chart.angle + line[0]);
  // d atan2(sine, size) = (size d sine - sine d size) / (size^2 + sine^2)
  const double square = size * size + sine * sine;
  const Eigen::RowVector3d by_moment = -sine / square * (moment / size).transpose();
  const double phi = std::atan2(sine, size);
  const double inside = std::clamp(phi, kStraight, 0.5 * M_PI - kStraight);
  const double slope = 2.0 / std::sin(2.0 * inside);

  const WorldLine world = line_in_world(chart, line);
  const Vector3 seen = world_R_body.transpose() * world.along;
  const double x = expected.along.dot(seen), y = expected.across.dot(seen);
  const Eigen::RowVector3d by_seen =
      (x * expected.across - y * expected.along).transpose() / std::max(x * x + y * y, kLeast);

  NewLine result;
  result.value << std::log(std::tan(inside)) + expected.log_distance + slope * (phi - inside),
      std::atan2(y, x);
  result.by_pose.setZero();
  result.by_pose.row(0).tail<3>() = slope * by_moment * hat(direction) * world_R_body;
  result.by_pose.row(1).head<3>() = by_seen * hat(seen);
  result.by_line.row(0) =
      by_moment * (pair.by_line.topRows<3>() - from_pose * pair.by_line.bottomRows<3>());
  result.by_line(0, 0) += size * cosine / square;
  result.by_line.row(0) *= slope;
  result.by_line.row(1) << 0.0, by_seen * world_R_body.transpose() * world.d_along;
  return result;
}

}  // namespace ruledgraph
