// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// How far away a line is, as an angle; needs Eigen alone. The native version of
// `line_angle_in_numpy` in `ruledgraph_factors/line_distance.py`, which says what is computed.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

struct LineAngle {
  double value;                      ///< phi, whose tangent is the inverse distance from the pose
  Eigen::Matrix<double, 1, 6> pose;  ///< its derivatives
  Eigen::Matrix<double, 1, 4> line;
};

inline LineAngle line_angle(const LineChart& chart, const Eigen::Vector4d& line,
                            const Matrix3& world_R_body, const Vector3& position) {
  const PlueckerPair pair = plucker(chart, line);
  const Vector3 direction = pair.value.tail<3>();
  const Matrix3 across = hat(position);
  const Vector3 moment = pair.value.head<3>() - across * direction;
  const double size = std::max(moment.norm(), 1e-12);
  const double sine = std::sin(chart.angle + line[0]), cosine = std::cos(chart.angle + line[0]);
  // d atan2(sine, size) = (size d sine - sine d size) / (size^2 + sine^2)
  const double square = size * size + sine * sine;
  const Eigen::RowVector3d by_moment = -sine / square * (moment / size).transpose();
  LineAngle angle;
  angle.value = std::atan2(sine, size);
  angle.pose << Eigen::RowVector3d::Zero(), by_moment * hat(direction) * world_R_body;
  angle.line = by_moment * (pair.by_line.topRows<3>() - across * pair.by_line.bottomRows<3>());
  angle.line[0] += size * cosine / square;
  return angle;
}

}  // namespace ruledgraph
