// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Charts of new lines: from Pluecker coordinates, from two points, from one image; needs Eigen
// alone. The C++ version of the constructors of `LineChart` in `ruledgraph_factors/line.py` and of
// `line_from_ruling`; a wrong argument throws std::invalid_argument.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ruledgraph/compress.hpp"
#include "ruledgraph/line_chart.hpp"

namespace ruledgraph {

/// Prior deviations of a new line's coordinates: anywhere in front and in any direction, while the
/// viewing plane is left to the points. Without a prior a new line is indeterminate.
inline Vector4 new_line_sigmas() { return {1.0, 1.0, 10.0, 10.0}; }

namespace detail {

/// Unit vector perpendicular to the unit `axis`, along `wish` or, where that is parallel to it,
/// the first column of the identity that is not, from column `first` on.
inline Vector3 unit_perpendicular(const Vector3& axis, const Vector3& wish, int first) {
  const auto rest = [&](const Vector3& v) -> Vector3 { return v - axis * axis.dot(v); };
  Vector3 found = rest(wish);
  double least = kNegligible;
  for (int i = first; !(found.norm() > least); ++i) {
    found = rest(Vector3::Unit(i % 3));
    least = 0.5;
  }
  // A second pass takes out what rounding left along the axis.
  return rest(found.normalized()).normalized();
}

}  // namespace detail

/// Chart around the world line (moment, direction), of any common scale. The part of `moment` along
/// `direction` is dropped; direction = 0 is a line at infinity, moment = 0 (about the anchor) a
/// line through the anchor's centre.
inline LineChart chart_from_plucker(const Pose& world_T_anchor, const Vector3& moment,
                                    const Vector3& direction) {
  const double largest = std::max(moment.cwiseAbs().maxCoeff(), direction.cwiseAbs().maxCoeff());
  if (!(largest > 0.0 && std::isfinite(largest))) {
    throw std::invalid_argument("ruledgraph: moment and direction are no line");
  }
  const Matrix3 anchor_R_world = world_T_anchor.rotation.transpose();
  Vector3 v = anchor_R_world * (direction / largest);
  Vector3 m = anchor_R_world * ((moment - world_T_anchor.position.cross(direction)) / largest);
  const double size = std::sqrt(m.squaredNorm() + v.squaredNorm());
  m /= size;
  v /= size;
  Vector3 u1, u2;
  if (v.norm() > kNegligible) {
    m -= v * v.dot(m) / v.squaredNorm();
    u2 = v.normalized();
    u1 = detail::unit_perpendicular(u2, m, 0);
  } else {
    u1 = m.normalized();
    u2 = detail::unit_perpendicular(u1, v, 1);
  }
  Matrix3 basis;
  basis << u1, u2, u1.cross(u2);
  return {world_T_anchor.rotation, world_T_anchor.position, basis, std::atan2(v.norm(), m.norm())};
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
  // The long axis of their scatter.
  const double angle = 0.5 * std::atan2(2.0 * xy, xx - yy);
  const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
  Vector3 normal(-along.y(), along.x(), middle.x() * along.y() - middle.y() * along.x());
  normal.normalize();
  Vector3 ray(middle.x(), middle.y(), 1.0);
  ray -= normal * normal.dot(ray);
  const Vector3 u3 = -ray.normalized();
  Matrix3 basis;
  basis << normal, u3.cross(normal), u3;
  return {world_T_cam.rotation, world_T_cam.position, basis, std::atan(inverse_distance)};
}

}  // namespace ruledgraph
