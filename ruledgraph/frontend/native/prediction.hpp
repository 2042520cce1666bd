// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Where lines appear in the next image; needs Eigen alone. The native version of the functions
// `..._in_numpy` in `ruling_prediction.py` and `edge_batch.py` in `ruledgraph/frontend/`, which
// stay the reference.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

constexpr double kThroughCentre = 1e-9;
constexpr double kAtInfinity = 1e-6;
constexpr double kAlongRay = 1e-4;
constexpr double kLevel = 1e-12, kLeastPart = 1e-6;
constexpr double kShortest = 1e-12;  // of a direction that is divided by

/// The ends of a segment, normalised, a row each.
using Segment = Eigen::Matrix2d;

/// A camera's pose in the world.
struct CameraPose {
  Matrix3 rotation;
  Vector3 position;
};

/// A line in the world and what is open of it.
struct UncertainLine {
  Vector3 moment, direction;
  Eigen::Matrix<double, 3, 4> moment_by_line, direction_by_line;
  Eigen::Matrix4d covariance;
  Segment seen;  ///< in the last image
  double floor;  ///< least deviation, px
};

/// A predicted segment and its deviations at the ends, px.
struct Predicted {
  Segment ends;
  Eigen::Vector2d sigmas;
};

/// The point of the line closest to the ray through `seen`; NaN where they are parallel or the line
/// is at infinity.
inline Vector3 closest_to_ray(const UncertainLine& line, const CameraPose& camera,
                              const Eigen::RowVector2d& seen) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const double length = line.direction.norm();
  const Vector3 unit = line.direction / (length > kAtInfinity ? length : kNan);
  const Vector3 foot = unit.cross(line.moment) / length;
  const Vector3 ray = (camera.rotation * Vector3(seen.x(), seen.y(), 1.0)).normalized();
  const Vector3 offset = camera.position - foot;
  const double cosine = ray.dot(unit), sine2 = 1.0 - cosine * cosine;
  const double along = unit.dot(offset) - cosine * ray.dot(offset);
  return foot + along / (sine2 < kAlongRay ? kNan : sine2) * unit;
}

/// Of `TracksConfig` in Python, which says what they mean and where their values come from.
struct PredictionLimits {
  double max_sigma, nearest;
};

/// By a line's estimate; `otherwise` is what is known without its depth.
inline Predicted predict(const UncertainLine& line, const CameraPose& before, const CameraPose& now,
                         const Predicted& otherwise, double focal, PredictionLimits limits) {
  const Matrix3 cam_R_world = now.rotation.transpose();
  const Vector3 m = cam_R_world * (line.moment - now.position.cross(line.direction));
  const double size = std::hypot(m.x(), m.y());
  if (!(size >= kThroughCentre)) return otherwise;
  const Eigen::Matrix<double, 3, 4> m_by_line =
      cam_R_world * (line.moment_by_line - hat(now.position) * line.direction_by_line);
  Predicted found;
  for (int i = 0; i < 2; ++i) {
    Eigen::RowVector2d end = otherwise.ends.row(i);
    const Vector3 in_cam =
        cam_R_world * (closest_to_ray(line, before, line.seen.row(i)) - now.position);
    if (in_cam.z() > limits.nearest) end << in_cam.x() / in_cam.z(), in_cam.y() / in_cam.z();
    // Onto the ruling.
    end -= Vector3(end.x(), end.y(), 1.0).dot(m) / (size * size) * m.head<2>().transpose();
    const Eigen::RowVector4d gradient =
        Eigen::RowVector3d(end.x(), end.y(), 1.0) * m_by_line / size;
    const double variance = (gradient * line.covariance).dot(gradient);
    const double sigma = std::hypot(focal * std::sqrt(std::max(variance, 0.0)), line.floor);
    found.ends.row(i) = end;
    found.sigmas[i] = std::min(sigma, limits.max_sigma);
  }
  return found;
}

/// A segment after the camera turned, moved on across itself at both ends.
inline Segment turned(const Segment& ends, const Matrix3& cam_R_before,
                      const Eigen::Vector2d& moved) {
  Segment now;
  for (int i = 0; i < 2; ++i) {
    const Vector3 ray = cam_R_before * Vector3(ends(i, 0), ends(i, 1), 1.0);
    now.row(i) << ray.x() / ray.z(), ray.y() / ray.z();
  }
  const Eigen::RowVector2d along = now.row(1) - now.row(0);
  const double length = std::max(std::hypot(along.x(), along.y()), kShortest);
  const Eigen::RowVector2d normal(-along.y() / length, along.x() / length);
  now.row(0) += moved[0] * normal;
  now.row(1) += moved[1] * normal;
  return now;
}

/// The part of a segment inside a field of view, and whether there is one; else all of it.
inline std::pair<Segment, bool> part_in_view(const Segment& ends, const Eigen::RowVector2d& low,
                                             const Eigen::RowVector2d& high) {
  const Eigen::RowVector2d start = ends.row(0), along = ends.row(1) - ends.row(0);
  double first = 0.0, last = 1.0;
  for (int axis = 0; axis < 2; ++axis) {
    if (std::abs(along[axis]) < kLevel) {
      // Along the other axis: inside all the way or not at all.
      if (!(low[axis] <= start[axis] && start[axis] <= high[axis])) last = -1.0;
      continue;
    }
    const double a = (low[axis] - start[axis]) / along[axis];
    const double b = (high[axis] - start[axis]) / along[axis];
    first = std::max(first, std::min(a, b));
    last = std::min(last, std::max(a, b));
  }
  if (!(ends.allFinite() && last - first > kLeastPart)) return {ends, false};
  Segment part;
  part.row(0) = start + first * along;
  part.row(1) = start + last * along;
  return {part, true};
}

}  // namespace ruledgraph
