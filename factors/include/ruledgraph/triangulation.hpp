// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// A line from two or more views, the cameras' poses being known; needs Eigen alone. The C++ version
// of `triangulate_line` in `ruledgraph_factors/triangulation.py`, where the equations are.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ruledgraph/line_coordinates.hpp"
#include "ruledgraph/line_fit.hpp"
#include "ruledgraph/new_line.hpp"
#include "ruledgraph/observations.hpp"

namespace ruledgraph {

/// Outcome of `triangulate_line`: the line is determined, or why its distance and direction are
/// not.
enum class LineStatus { kDetermined, kNoBaseline, kWithinPlane, kNoParallax, kBehindCamera };

/// A line from several views.
struct LineTriangulation {
  LineChart chart;             ///< anchored in the first camera; the line is at zero
  Eigen::Matrix4d covariance;  ///< of its coordinates, from the points and `new_line_sigmas`
  double rms;                  ///< root mean square distance of the points, normalised image units
  LineStatus status;
  std::string reason;  ///< the status in a sentence; empty when determined

  bool determined() const { return status == LineStatus::kDetermined; }
};

namespace detail {

/// Cameras in the frame of the first, and their points.
class Views {
 public:
  Views(const std::vector<Pose>& world_T_cams, const GeometricPoints& points, double information)
      : points_(points), information_(information), anchor_(world_T_cams.front()) {
    const Matrix3 first_R_world = anchor_.rotation.transpose();
    for (const Pose& camera : world_T_cams) {
      cameras_.push_back(
          {first_R_world * camera.rotation, first_R_world * (camera.position - anchor_.position)});
      FrameMotion motion{0.0, Vector6::Zero(), Matrix6::Zero()};
      motion.preintegrated << logarithm(cameras_.back().rotation), cameras_.back().position;
      motions_.push_back(motion);
    }
    const Matrix3 moments = points.statistics[0].transpose() * points.statistics[0];
    const Eigen::Vector2d middle = moments.topRightCorner<2, 1>() / moments(2, 2);
    const Eigen::Matrix2d scatter =
        moments.topLeftCorner<2, 2>() / moments(2, 2) - middle * middle.transpose();
    constexpr double kCoincident = 1e-14;
    if (!(scatter.trace() > kCoincident)) {
      throw std::invalid_argument("ruledgraph: all points of the first view coincide");
    }
    const Vector3 line = image_line(scatter, middle);
    normal_ = line.normalized();
    chart_ = chart_from_image_line(anchor_, line, kInverseDistances[1], middle);
    prior_ = new_line_sigmas().cwiseAbs2().cwiseInverse();
  }

  const LineChart& chart() const { return chart_; }
  const Vector4& prior() const { return prior_; }

  LineMinimum fit() const {
    std::vector<Vector4> starts;
    for (const double inverse : kInverseDistances) {
      for (const double turn : kTurns) {
        starts.emplace_back(std::atan(inverse) - chart_.angle, turn, 0.0, 0.0);
      }
    }
    LineMinimum best = descend(chart_, {linear()}, prior_, 1);
    const LineMinimum other = descend(chart_, starts, prior_, kDescents);
    if (other.cost < (1.0 - kRounding) * best.cost) best = other;
    for (int i = 0; i < kMostDescents; ++i) {  // each takes a few steps
      const LineMinimum next = descend(chart_, {best.delta}, prior_, 1);
      const double gained = best.cost - next.cost;
      best = next;
      if (gained < kConverged * next.cost) break;
    }
    return best;
  }

  /// Of the plane alone; distance and direction are those of the prior, and so known.
  LineMinimum fit_plane() const {
    LineMinimum found = descend(chart_, {Vector4::Zero()}, plane_alone(), 1);
    Eigen::Matrix4d hessian = prior_.asDiagonal();
    hessian.bottomRightCorner<2, 2>() = found.hessian.bottomRightCorner<2, 2>();
    found.hessian = hessian;
    return found;
  }

  /// Verdict on a fit with this sum of squared whitened distances.
  std::pair<LineStatus, std::string> judge(const LineChart& chart, double squares) const {
    double across = 0.0, baseline = 0.0;
    for (const Pose& camera : cameras_) {
      across = std::max(across, std::abs(camera.position.dot(normal_)));
      baseline = std::max(baseline, camera.position.norm());
    }
    if (baseline == 0.0) {
      return {LineStatus::kNoBaseline,
              "all views are from one place: they show the line's plane alone"};
    }
    LineChart at_infinity = chart;
    at_infinity.angle = 0.0;
    const double plane = descend(at_infinity, {Vector4::Zero()}, plane_alone(), 1).cost;
    if (plane - squares < -2.0 * std::log(1.0 - kConfidence)) {
      char moved[128];
      std::snprintf(moved, sizeof moved,
                    "the cameras move %.3g m, %.3g m of it across the line's plane", baseline,
                    across);
      if (across < kWithinPlane * baseline) {
        return {LineStatus::kWithinPlane,
                std::string(moved) + ": along the line, or straight towards it"};
      }
      return {LineStatus::kNoParallax,
              std::string(moved) + ": too little for a line so far away, or for the noise"};
    }
    if (!in_front(chart)) {
      return {LineStatus::kBehindCamera, "the line lies behind most of the cameras that see it"};
    }
    return {LineStatus::kDetermined, ""};
  }

 private:
  /// Confidence that the views show more than one plane.
  static constexpr double kConfidence = 0.999;
  /// Motion at less than this to the viewing plane, rad, is called motion within it.
  static constexpr double kWithinPlane = 0.1;
  /// Where to start beside the linear solution: 1/m, and turns in the plane, rad.
  static constexpr double kInverseDistances[] = {0.05, 0.25, 0.7, 1.6};
  static constexpr double kTurns[] = {-0.7, 0.0, 0.7};
  static constexpr std::size_t kDescents = 2;
  static constexpr int kMostDescents = 5;
  static constexpr double kConverged = 1e-3;
  /// Costs that differ by less, relatively, are those of one minimum.
  static constexpr double kRounding = 1e-6;

  /// Holds the distance and the direction, leaves the plane to the points.
  static Vector4 plane_alone() { return {1e12, 1e12, 0.0, 0.0}; }

  LineMinimum descend(const LineChart& chart, const std::vector<Vector4>& starts,
                      const Vector4& prior, std::size_t descents) const {
    // A factor whose frames are cameras that stand fast.
    const Geometry geometry(chart, Matrix3::Identity(), Vector3::Zero(), motions_, Vector6::Zero());
    const State state{anchor_.rotation, anchor_.position, Vector3::Zero(),
                      Vector6::Zero(),  Vector3::Zero(),  Vector4::Zero()};
    LineProblem<GeometricPoints> problem(geometry, points_, state, information_, prior);
    return fit_line(problem, starts, descents);
  }

  /// Coordinates of the linear solution.
  Vector4 linear() const {
    const Eigen::Matrix<double, 3, 2> across = chart_.basis.rightCols<2>();
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, 4>;
    Rows rows(points_.rows(), 4);
    Eigen::VectorXd target(points_.rows());
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      const Matrix3 cam_R_first = cameras_[i].rotation.transpose();
      const Vector3 seen = cam_R_first * normal_;
      const double size = std::max(std::hypot(seen.x(), seen.y()), 1e-3);
      const Matrix3 by_moment = points_.statistics[i] * cam_R_first / size;
      const Eigen::Index row = 3 * static_cast<Eigen::Index>(i);
      rows.block<3, 2>(row, 0) = by_moment * across;
      rows.block<3, 2>(row, 2) = -by_moment * hat(cameras_[i].position) * across;
      target.segment<3>(row) = -by_moment * normal_;
    }
    // What the views leave open becomes zero.
    Eigen::ColPivHouseholderQR<Rows> decomposition(rows.rows(), 4);
    decomposition.setThreshold(1e-9);
    const Vector4 solution = decomposition.compute(rows).solve(target);
    const Vector3 direction = anchor_.rotation * (across * solution.tail<2>());
    const Vector3 moment = anchor_.rotation * (normal_ + across * solution.head<2>()) +
                           anchor_.position.cross(direction);
    return local(chart_, moment, direction);
  }

  /// Whether the line has positive depth at the middle of the points of most views.
  bool in_front(const LineChart& chart) const {
    const Vector3 moment = std::cos(chart.angle) * chart.basis.col(0);
    const Vector3 direction = std::sin(chart.angle) * chart.basis.col(1);
    const Eigen::Matrix2Xd middle = middles(points_);
    std::vector<double> depths;
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      const Vector3 ray =
          cameras_[i].rotation * middle.col(static_cast<Eigen::Index>(i)).homogeneous();
      // x = depth ray, x cross v = m: the depth has the sign of (ray cross v) . m
      depths.push_back(ray.cross(direction).dot(moment - cameras_[i].position.cross(direction)));
    }
    std::sort(depths.begin(), depths.end());
    const std::size_t half = depths.size() / 2;
    return depths.size() % 2 == 1 ? depths[half] > 0.0 : depths[half - 1] + depths[half] > 0.0;
  }

  GeometricPoints points_;
  double information_;
  Pose anchor_;
  std::vector<Pose> cameras_;
  std::vector<FrameMotion> motions_;
  Vector3 normal_;
  LineChart chart_;
  Vector4 prior_;
};

}  // namespace detail

/// Line through the edge points of two or more views: the counterpart of GTSAM's
/// `triangulatePoint3`. `world_T_cams` are the cameras (optical axes) of the views, the first
/// anchors the chart; `sigma` is the deviation of a point across the line, normalised image units.
/// Errors of the poses are not in the covariance; do not use it as a prior beside factors of the
/// same points. A degenerate configuration is a status, not an error; views that do not fit
/// together, or a first view whose points coincide, throw std::invalid_argument.
inline LineTriangulation triangulate_line(const std::vector<Pose>& world_T_cams,
                                          const GeometricPoints& points, double sigma = 1e-3) {
  if (world_T_cams.empty() || points.frames() != world_T_cams.size()) {
    throw std::invalid_argument("ruledgraph: the points are not from these views");
  }
  if (!(sigma > 0.0)) throw std::invalid_argument("ruledgraph: sigma must be positive");
  const detail::Views views(world_T_cams, points, 1.0 / (sigma * sigma));
  LineMinimum fit = views.fit();
  Reanchored found = recentred(views.chart(), fit.delta);
  double squares = fit.cost - views.prior().dot(fit.delta.cwiseAbs2());
  auto [status, reason] = views.judge(found.chart, squares);
  if (status == LineStatus::kNoBaseline || status == LineStatus::kWithinPlane) {
    // What the fit made of these two is noise.
    fit = views.fit_plane();
    found = recentred(views.chart(), fit.delta);
    squares = fit.cost;
  }
  const Eigen::Matrix4d covariance =
      found.by_line * fit.hessian.inverse() * found.by_line.transpose();
  const double rms = std::sqrt(std::max(squares, 0.0) / total_weight(points)) * sigma;
  return {found.chart, 0.5 * (covariance + covariance.transpose()), rms, status, reason};
}

/// The same from the points themselves, (N_i, 2) of each view.
inline LineTriangulation triangulate_line(const std::vector<Pose>& world_T_cams,
                                          const std::vector<PointRows>& points,
                                          double sigma = 1e-3) {
  return triangulate_line(world_T_cams, compress_points(points), sigma);
}

}  // namespace ruledgraph
