// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Charts of new lines: from Pluecker coordinates, from two points, from one image; needs Eigen
// alone. The C++ version of the constructors of `LineChart` in `ruledgraph_factors/line.py` and of
// `line_from_ruling`; a wrong argument throws std::invalid_argument.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>

#include "ruledgraph/compress.hpp"
#include "ruledgraph/line_chart.hpp"
#include "ruledgraph/line_coordinates.hpp"

namespace ruledgraph {

/// Prior deviations of a new line's coordinates: anywhere in front and in any direction, while the
/// viewing plane is left to the points. Without a prior a new line is indeterminate.
inline Vector4 new_line_sigmas() { return {1.0, 1.0, 10.0, 10.0}; }

/// Chart around the world line (moment, direction), of any common scale. The part of `moment` along
/// `direction` is dropped; direction = 0 is a line at infinity, moment = 0 (about the anchor) a
/// line through the anchor's centre.
inline LineChart chart_from_plucker(const Pose& world_T_anchor, const Vector3& moment,
                                    const Vector3& direction) {
  const PlueckerPairInAnchor pair = unit_pair(world_T_anchor, moment, direction);
  return {world_T_anchor.rotation, world_T_anchor.position,
          orthonormal_basis(pair, Matrix3::Identity()),
          std::atan2(pair.direction.norm(), pair.moment.norm())};
}

/// Chart around the line through two distinct world points, from first to second.
inline LineChart chart_from_points(const Pose& world_T_anchor, const Vector3& first,
                                   const Vector3& second) {
  const double length = (second - first).norm();
  if (!(length > kNegligible * (1.0 + first.norm()))) {
    throw std::invalid_argument("ruledgraph: the two points of a line coincide");
  }
  const Vector3 direction = (second - first) / length;
  return chart_from_plucker(world_T_anchor, first.cross(direction), direction);
}

/// Chart around the line whose image is a x + b y + c = 0, perpendicular to the ray through `foot`,
/// an image point on it, and at 1 / inverse_distance from the camera's centre.
inline LineChart chart_from_image_line(const Pose& world_T_cam, const Vector3& image_line,
                                       double inverse_distance, const Eigen::Vector2d& foot) {
  const Vector3 normal = image_line.normalized();
  Vector3 ray(foot.x(), foot.y(), 1.0);
  ray -= normal * normal.dot(ray);
  const Vector3 u3 = -ray.normalized();
  Matrix3 basis;
  basis << normal, u3.cross(normal), u3;
  return {world_T_cam.rotation, world_T_cam.position, basis, std::atan(inverse_distance)};
}

/// (a, b, c) of the line a x + b y + c = 0 through `middle` along the long axis of a scatter.
inline Vector3 image_line(const Eigen::Matrix2d& scatter, const Eigen::Vector2d& middle) {
  const double angle = 0.5 * std::atan2(2.0 * scatter(0, 1), scatter(0, 0) - scatter(1, 1));
  const Eigen::Vector2d across(-std::sin(angle), std::cos(angle));
  return {across.x(), across.y(), -across.dot(middle)};
}

/// Chart of a new line from its edge points in one image, normalised, a row each, at least two
/// distinct ones, and a guess of its inverse distance, >= 0, 1/m. The image line is the
/// total-least-squares fit; the line is taken perpendicular to the ray through the middle of the
/// points. Give the two unseen directions a wide prior: `new_line_sigmas`.
inline LineChart line_from_ruling(const Pose& world_T_cam,
                                  const Eigen::Ref<const PointRows>& points,
                                  double inverse_distance) {
  if (points.rows() < 2 || !points.allFinite()) {
    throw std::invalid_argument("ruledgraph: a line takes two finite points");
  }
  if (!(inverse_distance >= 0.0)) {
    throw std::invalid_argument("ruledgraph: inverse_distance must not be negative");
  }
  const Eigen::RowVector2d middle = points.colwise().mean();
  const PointRows offsets = points.rowwise() - middle;
  const double xx = offsets.col(0).squaredNorm(), yy = offsets.col(1).squaredNorm();
  const double xy = offsets.col(0).dot(offsets.col(1));
  if (!(std::sqrt(xx + yy) > kNegligible)) {
    throw std::invalid_argument("ruledgraph: all points of a line coincide");
  }
  const Eigen::Vector2d at = middle.transpose();
  const Vector3 line = image_line((Eigen::Matrix2d() << xx, xy, xy, yy).finished(), at);
  return chart_from_image_line(world_T_cam, line, inverse_distance, at);
}

}  // namespace ruledgraph
