// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Where a line of the graph appears in the next image; needs Eigen alone. The native version of
// `predict_in_numpy` in `ruledgraph/prediction.py`, which stays the reference.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

constexpr double kMostSigma = 8.0;
constexpr double kNearest = 0.05;
constexpr double kThroughCentre = 1e-9;
constexpr double kAtInfinity = 1e-6;
constexpr double kAlongRay = 1e-4;

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
  Eigen::Matrix2d seen;  ///< the ends in the last image, a row each
  double floor;          ///< least deviation, px
};

/// The ends (rows) and deviations (px) of a predicted segment.
struct Predicted {
  Eigen::Matrix2d ends;
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

/// By a line's estimate; `otherwise` is what is known without its depth.
inline Predicted predict(const UncertainLine& line, const CameraPose& before, const CameraPose& now,
                         const Predicted& otherwise, double focal) {
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
    if (in_cam.z() > kNearest) end << in_cam.x() / in_cam.z(), in_cam.y() / in_cam.z();
    // Onto the ruling.
    end -= Vector3(end.x(), end.y(), 1.0).dot(m) / (size * size) * m.head<2>().transpose();
    const Eigen::RowVector4d gradient =
        Eigen::RowVector3d(end.x(), end.y(), 1.0) * m_by_line / size;
    const double variance = (gradient * line.covariance).dot(gradient);
    const double sigma = std::hypot(focal * std::sqrt(std::max(variance, 0.0)), line.floor);
    found.ends.row(i) = end;
    found.sigmas[i] = std::min(sigma, kMostSigma);
  }
  return found;
}

}  // namespace ruledgraph
