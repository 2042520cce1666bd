// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Settings of GTSAM's solvers that suit lines, a line in a new chart, and whether lines ended in a
// wrong minimum. The C++ versions of `ruledgraph_factors/solvers.py` and `check.py`.
#pragma once

#include <gtsam/linear/NoiseModel.h>
#include <gtsam/nonlinear/ISAM2Params.h>
#include <gtsam/nonlinear/LevenbergMarquardtParams.h>
#include <gtsam/nonlinear/NonlinearFactorGraph.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "ruledgraph/gtsam/line_factors.hpp"
#include "ruledgraph/gtsam/line_observation.hpp"
#include "ruledgraph/line_coordinates.hpp"

namespace ruledgraph {

/// Dogleg steps, relinearised at every update.
inline gtsam::ISAM2Params isam2_params(double relinearize_threshold = 0.01) {
  gtsam::ISAM2Params params;
  params.optimizationParams = gtsam::ISAM2DoglegParams();
  params.relinearizeThreshold = relinearize_threshold;
  params.relinearizeSkip = 1;
  return params;
}

/// Damping along the diagonal: beside stiff priors GTSAM's default may never take a step.
inline gtsam::LevenbergMarquardtParams levenberg_marquardt_params() {
  gtsam::LevenbergMarquardtParams params;
  params.setDiagonalDamping(true);
  params.setlambdaUpperBound(1e10);
  return params;
}

/// What changes in a graph when a line gets another chart and key.
struct MovedLine {
  gtsam::NonlinearFactorGraph factors;  ///< its ruled-surface factors, on the new key
  gtsam::FactorIndices indices;         ///< of all factors on the old key: to be removed
};

/// A line in a new chart, for graphs that keep all their factors (batch, ISAM2). Insert the new
/// variable as zero and give it a new prior if the old one had one.
inline MovedLine move_line(const gtsam::NonlinearFactorGraph& graph, gtsam::Key line_key,
                           gtsam::Key new_line_key, const LineChart& chart) {
  MovedLine moved;
  for (std::size_t i = 0; i < graph.size(); ++i) {
    const auto& factor = graph[i];
    if (!factor) continue;
    const auto& keys = factor->keys();
    if (std::find(keys.begin(), keys.end(), line_key) == keys.end()) continue;
    moved.indices.push_back(i);
    const auto* observation = dynamic_cast<const LineObservation*>(&*factor);
    if (observation != nullptr)
      moved.factors.push_back(observation->with_line(new_line_key, chart));
  }
  return moved;
}

/// One line of a graph at an estimate, by all its ruled-surface factors.
struct LineCheck {
  gtsam::Key key;
  double chi_squared;  ///< of all its points, robust losses left out
  double expected;     ///< its expectation at the right minimum: their `degrees_of_freedom`
  double limit;        ///< the 99.9 % quantile of the chi-squared distribution
  double behind;       ///< share of its frames whose camera has the line behind it
  bool far;            ///< `is_far`
  /// Its factors, priors included, have different charts. They must have the same one: its
  /// coordinates, and so all other figures here, mean nothing.
  bool mixed_charts = false;

  /// There is NaN in its coordinates, or in another variable of its factors.
  bool undefined() const { return std::isnan(chi_squared); }
  /// The points contradict the line: a wrong minimum, wrong points, or wrong noise.
  bool misfit() const { return chi_squared > limit; }
  /// Nothing speaks against the line.
  bool ok() const { return !(undefined() || misfit() || far || behind > 0.5 || mixed_charts); }
};

namespace detail {

inline double whitened_square(const gtsam::SharedNoiseModel& model, const gtsam::Vector& residual) {
  const auto* robust = dynamic_cast<const gtsam::noiseModel::Robust*>(&*model);
  return (robust != nullptr ? robust->noise()->whiten(residual) : model->whiten(residual))
      .squaredNorm();
}

/// The charts that a factor has its lines in, by their keys; empty of other factors.
inline std::vector<std::pair<gtsam::Key, LineChart>> charts_of(
    const gtsam::NonlinearFactor& factor) {
  const auto& keys = factor.keys();
  if (const auto* seen = dynamic_cast<const LineObservation*>(&factor)) {
    return {{seen->line_key(), seen->surface().geometry().chart()}};
  }
  if (const auto* prior = dynamic_cast<const NewLineFactor*>(&factor)) {
    return {{keys[1], prior->chart()}};
  }
  if (const auto* distance = dynamic_cast<const LineDistanceFactor*>(&factor)) {
    return {{keys[1], distance->chart()}};
  }
  if (const auto* tie = dynamic_cast<const SameLineFactor*>(&factor)) {
    return {{keys[0], tie->chart()}, {keys[1], tie->new_chart()}};
  }
  return {};
}

/// How many frames have the line behind their camera at the middle of the points.
inline int frames_behind(const LineObservation& factor, const gtsam::Values& values) {
  const Geometry geometry = factor.geometry_at(values);
  const State state = factor.state_at(values);
  const WorldLine world = geometry.line_in_world(state);
  const Eigen::Matrix2Xd middle =
      std::visit([](const auto& points) { return middles(points); }, factor.surface().points());
  int behind = 0;
  for (std::size_t i = 0; i < geometry.frames(); ++i) {
    const CameraLine line = geometry.line_in_camera(i, state, world, false);
    Vector3 ray = middle.col(static_cast<Eigen::Index>(i)).homogeneous();
    ray.z() = state.focal_ratio;
    // x = depth ray, x cross v = m: the depth has the sign of (ray cross v) . m
    const double depth = ray.cross(line.direction).dot(line.moment);
    if ((world.sine >= 0.0 ? depth : -depth) < 0.0) ++behind;
  }
  return behind;
}

}  // namespace detail

/// All lines of a graph at an estimate: which of them ended in a wrong minimum, have factors with
/// different charts, or NaN? One check for each line key that is observed, in order of the keys.
inline std::vector<LineCheck> check_lines(const gtsam::NonlinearFactorGraph& graph,
                                          const gtsam::Values& values) {
  constexpr double kQuantile = 3.09;   // of the standard normal distribution: 99.9 %
  constexpr double kRounding = 1e-9;   // of the numbers of a chart, m or rad
  std::map<gtsam::Key, Vector4> sums;  // of chi_squared, expected, frames, behind
  std::map<gtsam::Key, LineChart> charts;
  std::set<gtsam::Key> mixed;
  for (std::size_t i = 0; i < graph.size(); ++i) {
    if (!graph[i]) continue;
    for (const auto& [key, chart] : detail::charts_of(*graph[i])) {
      const LineChart& first = charts.emplace(key, chart).first->second;
      if (!detail::same_chart(first, chart, kRounding)) mixed.insert(key);
    }
    const auto* factor = dynamic_cast<const LineObservation*>(&*graph[i]);
    if (factor == nullptr) continue;
    const double expected = std::visit(
        [](const auto& points) { return degrees_of_freedom(points); }, factor->surface().points());
    const Vector4 row(
        detail::whitened_square(factor->noiseModel(), factor->unwhitenedError(values)), expected,
        static_cast<double>(factor->surface().geometry().frames()),
        detail::frames_behind(*factor, values));
    sums.emplace(factor->line_key(), Vector4::Zero()).first->second += row;
  }
  std::vector<LineCheck> checks;
  for (const auto& [key, sum] : sums) {
    // Wilson and Hilferty's approximation of the quantile.
    const double third = 2.0 / (9.0 * sum[1]);
    const double limit = sum[1] * std::pow(1.0 - third + kQuantile * std::sqrt(third), 3);
    const bool far = is_far(values.at<gtsam::Vector4>(key));
    checks.push_back(
        {key, sum[0], sum[1], limit, sum[3] / sum[2], far, mixed.find(key) != mixed.end()});
  }
  return checks;
}

}  // namespace ruledgraph
