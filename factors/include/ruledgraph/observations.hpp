// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Edge points of one line, made ready for a factor; needs Eigen alone. The C++ version of
// `GeometricPoints.from_frames` and `without_scatter` and of `ReprojectionPoints.from_frames` in
// `ruledgraph_factors/observations.py`.
#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
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

inline void require_frames(const std::vector<PointRows>& frames) {
  if (frames.empty()) throw std::invalid_argument("ruledgraph: there are no frames");
}

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

/// Expected squared residual at the truth, over a point's variance: of a frame the weight of its
/// points, but at most 2 without their scatter (or of two points).
inline double degrees_of_freedom(const GeometricPoints& points) {
  double found = 0.0;
  for (const Matrix3& C : points.statistics) {
    const double weight = C.col(2).squaredNorm();
    found += C.row(2).isZero(0.0) ? std::min(weight, 2.0) : weight;
  }
  return found;
}
inline double degrees_of_freedom(const ReprojectionPoints& points) { return total_weight(points); }

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
    const Eigen::RowVectorXd weights = points.sqrt_weights.segment(first, count).cwiseAbs2();
    const auto seen = points.points.middleCols(first, count).array();
    found.col(static_cast<Eigen::Index>(i)) =
        (seen.rowwise() * weights.array()).rowwise().sum() / weights.sum();
    first += count;
  }
  return found;
}

/// The points of each frame, normalised image coordinates (N_i, 2), N_i >= 1, as triangular
/// statistics. `effective_points` is the most that a frame may say, in points: neighbouring edge
/// pixels are not independent. Throws std::invalid_argument for no frames, and for a frame without
/// points or with one that is not finite.
inline GeometricPoints compress_points(const std::vector<PointRows>& frames,
                                       double effective_points = kNoCap) {
  detail::require_frames(frames);
  GeometricPoints compressed;
  for (const PointRows& points : frames) {
    const double root = detail::capped_sqrt_weight(points, effective_points);
    compressed.statistics.push_back(
        compress(points, Eigen::VectorXd::Constant(points.rows(), root)));
  }
  return compressed;
}

/// The same points but for their scatter across their own best line, which no line explains.
///
/// For an image line l = (n, -rho), |n| = 1, and N points with mean p whose scatter matrix has the
/// eigenvalues a >= b, the larger one along e,
///
///     |C l|^2 = N (n.p - rho)^2 + (a - b) (n.e)^2 + b.
///
/// Without b, C has two rows and a third of zeros, and the squared residual of a frame, over the
/// variance of a point, is chi-square with two degrees of freedom, as robust losses and gates take
/// it to be.
inline GeometricPoints without_scatter(const GeometricPoints& points) {
  GeometricPoints found;
  for (const Matrix3& C : points.statistics) {
    const Matrix3 moments = C.transpose() * C;
    const double weight = moments(2, 2);
    const Eigen::Vector2d middle = moments.topRightCorner<2, 1>() / weight;
    const Eigen::Matrix2d scatter =
        moments.topLeftCorner<2, 2>() - weight * middle * middle.transpose();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> along;
    along.computeDirect(scatter);
    const double gap = along.eigenvalues()[1] - along.eigenvalues()[0];
    // Triangular again: the long axis turns into the rows of a QR of [mean; axis].
    Matrix3 rows = Matrix3::Zero();
    rows.row(0) = std::sqrt(weight) * middle.homogeneous().transpose();
    rows.row(1).head<2>() = std::sqrt(gap) * along.eigenvectors().col(1).transpose();
    found.statistics.push_back(detail::triangular_factor(rows));
  }
  return found;
}

/// The same points one by one, for the reprojection residual. Throws likewise.
inline ReprojectionPoints individual_points(const std::vector<PointRows>& frames,
                                            double effective_points = kNoCap) {
  detail::require_frames(frames);
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
