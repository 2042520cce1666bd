// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// From a line to its coordinates in a chart: the inverse of `plucker`, wrapping and recentring;
// needs Eigen alone. The C++ version of `local`, `wrapped`, `is_far` and `recentred` of `LineChart`
// in `ruledgraph_factors/line.py`, and of `ruledgraph_factors/plucker.py`.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ruledgraph/line_chart.hpp"

namespace ruledgraph {

/// A line in an anchor frame, of unit norm together, moment and direction perpendicular.
struct PlueckerPairInAnchor {
  Vector3 moment, direction;
};

/// The world line (moment, direction), of any common scale, seen from an anchor. The part of
/// `moment` along `direction` is dropped. Throws std::invalid_argument when both are zero.
inline PlueckerPairInAnchor unit_pair(const Pose& world_T_anchor, const Vector3& moment,
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
  if (v.norm() > kNegligible) m -= v * v.dot(m) / v.squaredNorm();
  return {m, v};
}

namespace detail {

/// Unit vector perpendicular to the unit `axis`, along `wish` or, where that is parallel to it,
/// the first column of `fallbacks` that is not, from column `first` on.
inline Vector3 unit_perpendicular(const Vector3& axis, const Vector3& wish,
                                  const Matrix3& fallbacks, int first) {
  const auto rest = [&](const Vector3& v) -> Vector3 { return v - axis * axis.dot(v); };
  Vector3 found = rest(wish);
  double least = kNegligible;
  for (int i = first; !(found.norm() > least) && i < first + 3; ++i) {
    found = rest(fallbacks.col(i % 3));
    least = 0.5;
  }
  // A second pass takes out what rounding left along the axis.
  return rest(found.normalized()).normalized();
}

}  // namespace detail

/// (u1 u2 u3) with u1 along the moment and u2 along the direction; what a zero one of them leaves
/// open comes as close to the columns of `preferred` as it can.
inline Matrix3 orthonormal_basis(const PlueckerPairInAnchor& pair, const Matrix3& preferred) {
  Vector3 u1, u2;
  if (pair.direction.norm() > kNegligible) {
    u2 = pair.direction.normalized();
    u1 = detail::unit_perpendicular(u2, pair.moment, preferred, 0);
  } else {
    u1 = pair.moment.normalized();
    u2 = detail::unit_perpendicular(u1, pair.direction, preferred, 1);
  }
  Matrix3 basis;
  basis << u1, u2, u1.cross(u2);
  return basis;
}

/// Coordinates of the line (u, angle) in a chart, the smallest: (m, v) and (-m, -v) are one line,
/// and so are (u2, phi) and (-u2, -phi), so that it has four frames u, and phi counts modulo pi.
inline Vector4 nearest_coordinates(const LineChart& chart, const Matrix3& u, double angle) {
  constexpr double kPi = 3.14159265358979323846;
  const Vector3 signs[4] = {
      {1.0, 1.0, 1.0}, {-1.0, -1.0, 1.0}, {1.0, -1.0, -1.0}, {-1.0, 1.0, -1.0}};
  Vector4 nearest;
  for (int i = 0; i < 4; ++i) {
    double turn = (i < 2 ? angle : -angle) - chart.angle;
    turn -= kPi * std::nearbyint(turn / kPi);
    Vector4 candidate;
    candidate << turn, logarithm(chart.basis.transpose() * (u * signs[i].asDiagonal()));
    if (i == 0 || candidate.squaredNorm() < nearest.squaredNorm()) nearest = candidate;
  }
  return nearest;
}

/// Coordinates of the world line (moment, direction) in a chart: the inverse of `plucker`.
inline Vector4 local(const LineChart& chart, const Vector3& moment, const Vector3& direction) {
  const PlueckerPairInAnchor pair = unit_pair(chart.world_T_anchor(), moment, direction);
  return nearest_coordinates(chart, orthonormal_basis(pair, chart.basis),
                             std::atan2(pair.direction.norm(), pair.moment.norm()));
}

/// Whether the norm of the coordinates is pi/2 or more: within that every line has one set of
/// them, from there on it may have wrapped. Time for `recentred`.
inline bool is_far(const Vector4& line) { return line.norm() >= 0.5 * 3.14159265358979323846; }

/// Other coordinates of the same line.
struct Wrapped {
  Vector4 line;
  Eigen::Matrix4d by_line;
};

/// The smallest coordinates of the same line, and their derivative.
inline Wrapped wrapped(const LineChart& chart, const Vector4& line) {
  const Exponential turn = exponential(line.tail<3>());
  const Matrix3 u = chart.basis * turn.rotation;
  Wrapped found{nearest_coordinates(chart, u, chart.angle + line[0]), Eigen::Matrix4d::Zero()};
  const Exponential there = exponential(found.line.tail<3>());
  // u' = u S with signs S; u Exp(w) S = u S Exp(S w), and phi' = s_1 s_2 phi.
  const Vector3 signs =
      u.cwiseProduct(chart.basis * there.rotation).colwise().sum().transpose().array().sign();
  found.by_line(0, 0) = signs[0] * signs[1];
  found.by_line.bottomRightCorner<3, 3>() =
      there.right_jacobian.partialPivLu().solve(signs.asDiagonal() * turn.right_jacobian);
  return found;
}

/// The same line in a chart around it, at the same anchor, the angle at most pi/2.
inline Reanchored recentred(const LineChart& chart, const Vector4& line) {
  constexpr double kPi = 3.14159265358979323846;
  const Exponential turn = exponential(line.tail<3>());
  const double phi = chart.angle + line[0];
  Reanchored found{
      {chart.world_R_anchor, chart.world_t_anchor, closest_rotation(chart.basis * turn.rotation),
       phi - kPi * std::nearbyint(phi / kPi)},
      Eigen::Matrix4d::Identity()};
  found.by_line.bottomRightCorner<3, 3>() = turn.right_jacobian;
  return found;
}

}  // namespace ruledgraph
