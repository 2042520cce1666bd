// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The 4-DoF line variable: a chart around a reference line in an anchor frame; needs Eigen alone.
// The C++ version of `LineChart` in `ruledgraph_factors/line.py`, which says what is computed and
// how it behaves at the ends of the chart. Charts are made in `new_line.hpp`.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

using Vector4 = Eigen::Vector4d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix34 = Eigen::Matrix<double, 3, 4>;

/// Below this, a unit Pluecker pair's direction (or moment) is rounding noise.
constexpr double kNegligible = 1e-12;

/// A rigid motion, such as world_T_body.
struct Pose {
  Matrix3 rotation = Matrix3::Identity();
  Vector3 position = Vector3::Zero();

  Pose operator*(const Pose& other) const {
    return {rotation * other.rotation, rotation * other.position + position};
  }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * position)}; }
};

/// The constants of the line variable.
struct LineChart {
  Matrix3 world_R_anchor = Matrix3::Identity();
  Vector3 world_t_anchor = Vector3::Zero();
  Matrix3 basis = Matrix3::Identity();  ///< columns u1, u2, u3 of the reference line in the anchor
                                        ///< frame
  double angle = 0.0;  ///< its tangent is the reference line's inverse distance, 1/m

  Pose world_T_anchor() const { return {world_R_anchor, world_t_anchor}; }
};

/// A line's world Pluecker pair (moment, direction) and its derivative by the four coordinates;
/// see `LineChart.plucker` in Python.
struct PlueckerPair {
  Vector6 value;
  Eigen::Matrix<double, 6, 4> by_line;
};

/// The line of one state, in the world.
struct WorldLine {
  Vector3 normal, along;
  double cosine, sine;
  Matrix3 d_normal, d_along;  ///< by the last three of the line's coordinates
};

/// The line at these coordinates of a chart.
inline WorldLine line_in_world(const LineChart& chart, const Vector4& line) {
  const Exponential turn = exponential(line.tail<3>());
  const double phi = chart.angle + line[0];
  const Matrix3 world_R_line = chart.world_R_anchor * (chart.basis * turn.rotation);
  // u1 and u2 turn with w = Jr delta.
  return {world_R_line.col(0),
          world_R_line.col(1),
          std::cos(phi),
          std::sin(phi),
          -world_R_line * hat(Vector3::UnitX()) * turn.right_jacobian,
          -world_R_line * hat(Vector3::UnitY()) * turn.right_jacobian};
}

inline PlueckerPair plucker(const LineChart& chart, const Vector4& line) {
  const WorldLine world = line_in_world(chart, line);
  const Matrix3 across = hat(chart.world_t_anchor);
  const Vector3 turned = across * world.along;
  PlueckerPair pair;
  pair.value << world.cosine * world.normal + world.sine * turned, world.sine * world.along;
  pair.by_line.col(0) << world.cosine * turned - world.sine * world.normal,
      world.cosine * world.along;
  pair.by_line.topRightCorner<3, 3>() =
      world.cosine * world.d_normal + world.sine * (across * world.d_along);
  pair.by_line.bottomRightCorner<3, 3>() = world.sine * world.d_along;
  return pair;
}

/// A vector in the world and its derivative by the line's coordinates.
struct OfLine {
  Vector3 value;
  Matrix34 by_line;
};

/// Unit direction.
inline OfLine direction(const LineChart& chart, const Vector4& line) {
  const WorldLine world = line_in_world(chart, line);
  Matrix34 by_line = Matrix34::Zero();
  by_line.rightCols<3>() = world.d_along;
  return {world.along, by_line};
}

/// The line's point closest to `to` in the world, m. Throws std::invalid_argument for a line at
/// infinity.
inline OfLine closest_point(const LineChart& chart, const Vector4& line, const Vector3& to) {
  const WorldLine world = line_in_world(chart, line);
  if (std::abs(world.sine) <= kNegligible) {
    throw std::invalid_argument("ruledgraph: the line is at infinity and has no finite point");
  }
  // Seen from the anchor it is S / sin(phi) + (v . (to - anchor)) v with S = v x (cos(phi) u1).
  const Vector3& v = world.along;
  const double distance = world.cosine / world.sine;
  const Vector3 target = to - chart.world_t_anchor;
  const Vector3 foot = v.cross(world.normal);
  const double reach = v.dot(target);
  OfLine found;
  found.value = chart.world_t_anchor + distance * foot + reach * v;
  found.by_line.col(0) = -foot / (world.sine * world.sine);
  found.by_line.rightCols<3>() =
      distance * (hat(v) * world.d_normal - hat(world.normal) * world.d_along) +
      reach * world.d_along + v * (target.transpose() * world.d_along);
  return found;
}

/// The line's point closest to the anchor's centre.
inline OfLine closest_point(const LineChart& chart, const Vector4& line) {
  return closest_point(chart, line, chart.world_t_anchor);
}

/// The same line in a new chart, where it is at zero.
struct Reanchored {
  LineChart chart;
  Eigen::Matrix4d by_line;  ///< J, of the new coordinates by the old: a covariance is J S J^T
};

/// Anchor a line anew. Throws std::invalid_argument when it runs through the new anchor's centre.
inline Reanchored reanchor(const LineChart& chart, const Vector4& line,
                           const Pose& world_T_anchor) {
  const WorldLine world = line_in_world(chart, line);
  const Matrix3 anchor_R_world = world_T_anchor.rotation.transpose();
  const Vector3 lever = chart.world_t_anchor - world_T_anchor.position;
  const Vector3 turned = lever.cross(world.along);
  const Vector3 along = anchor_R_world * world.along;
  const Vector3 moment = anchor_R_world * (world.cosine * world.normal + world.sine * turned);
  Matrix34 d_along = Matrix34::Zero(), d_moment;
  d_along.rightCols<3>() = anchor_R_world * world.d_along;
  d_moment << anchor_R_world * (world.cosine * turned - world.sine * world.normal),
      anchor_R_world * (world.cosine * world.d_normal + world.sine * (hat(lever) * world.d_along));
  const double size = moment.norm();
  if (size <= kNegligible * (1.0 + lever.norm())) {
    throw std::invalid_argument("ruledgraph: the line runs through the new anchor's centre");
  }
  Matrix3 basis;
  basis << moment / size, along, moment.cross(along) / size;
  const Eigen::RowVector4d d_size = basis.col(0).transpose() * d_moment;
  const Matrix34 d_normal = (d_moment - basis.col(0) * d_size) / size;
  // From U = U Exp(w): u3 . du2 = w0, -u3 . du1 = w1, u2 . du1 = w2; phi = atan2(sine, size).
  Reanchored found;
  found.by_line.row(0) = -world.sine / (size * size + world.sine * world.sine) * d_size;
  found.by_line(0, 0) += size * world.cosine / (size * size + world.sine * world.sine);
  found.by_line.row(1) = basis.col(2).transpose() * d_along;
  found.by_line.row(2) = -basis.col(2).transpose() * d_normal;
  found.by_line.row(3) = basis.col(1).transpose() * d_normal;
  found.chart = {world_T_anchor.rotation, world_T_anchor.position, closest_rotation(basis),
                 std::atan2(world.sine, size)};
  return found;
}

}  // namespace ruledgraph
