// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Edge points of one line, made ready for a factor; needs Eigen alone. The C++ version of
// `GeometricPoints.from_frames` and `ReprojectionPoints.from_frames` in
// `ruledgraph_factors/observations.py`.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "ruledgraph/compress.hpp"
#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

constexpr double kNoCap = std::numeric_limits<double>::infinity();

namespace detail {

/// The root of the weight of each of a frame's points that keeps their sum below a cap.
inline double capped_sqrt_weight(const PointRows& points, double effective_points) {
  if (points.rows() == 0 || !points.allFinite()) {
    throw std::invalid_argument("ruledgraph: a frame without points, or with one not finite");
  }
  if (!(effective_points > 0.0)) {
    throw std::invalid_argument("ruledgraph: effective_points must be positive");
  }
  return std::sqrt(std::min(1.0, effective_points / static_cast<double>(points.rows())));
}

}  // namespace detail

/// What all points weigh together: their number, if each has weight 1.
inline double total_weight(const GeometricPoints& points) {
  double weight = 0.0;
  for (const Matrix3& C : points.statistics) weight += C.col(2).squaredNorm();
  return weight;
}
inline double total_weight(const ReprojectionPoints& points) {
  return points.sqrt_weights.squaredNorm();
}

/// Mean of the points of each frame, a column each.
inline Eigen::Matrix2Xd middles(const GeometricPoints& points) {
  Eigen::Matrix2Xd found(2, points.frames());
  for (std::size_t i = 0; i < points.frames(); ++i) {
    const Vector3 moments = points.statistics[i].transpose() * points.statistics[i].col(2);
    found.col(static_cast<Eigen::Index>(i)) = moments.head<2>() / moments.z();
  }
  return found;
}
inline Eigen::Matrix2Xd middles(const ReprojectionPoints& points) {
  Eigen::Matrix2Xd found(2, points.frames());
  Eigen::Index first = 0;
  for (std::size_t i = 0; i < points.frames(); ++i) {
    const auto count = points.counts[i];
    const Eigen::VectorXd weights = points.sqrt_weights.segment(first, count).cwiseAbs2();
    found.col(static_cast<Eigen::Index>(i)) =
        points.points.middleCols(first, count) * weights / weights.sum();
    first += count;
  }
  return found;
}

/// The points of each frame, normalised image coordinates (N_i, 2), N_i >= 1, as triangular
/// statistics. `effective_points` is the most that a frame may say, in points: neighbouring edge
/// pixels are not independent. Throws std::invalid_argument for a frame without points.
inline GeometricPoints compress_points(const std::vector<PointRows>& frames,
                                       double effective_points = kNoCap) {
  GeometricPoints compressed;
  for (const PointRows& points : frames) {
    const double root = detail::capped_sqrt_weight(points, effective_points);
    compressed.statistics.push_back(
        compress(points, Eigen::VectorXd::Constant(points.rows(), root)));
  }
  return compressed;
}

/// The same points one by one, for the reprojection residual.
inline ReprojectionPoints individual_points(const std::vector<PointRows>& frames,
                                            double effective_points = kNoCap) {
  Eigen::Index count = 0;
  for (const PointRows& points : frames) count += points.rows();
  ReprojectionPoints individual{Eigen::Matrix2Xd(2, count), Eigen::VectorXd(count), {}};
  Eigen::Index first = 0;
  for (const PointRows& points : frames) {
    const double root = detail::capped_sqrt_weight(points, effective_points);
    individual.points.middleCols(first, points.rows()) = points.transpose();
    individual.sqrt_weights.segment(first, points.rows()).setConstant(root);
    individual.counts.push_back(points.rows());
    first += points.rows();
  }
  return individual;
}

}  // namespace ruledgraph
