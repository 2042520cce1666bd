// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Least squares over a line alone; needs Eigen alone. The native version of `fit_line_in_numpy` in
// `ruledgraph_factors/line_fit.py`, which says what is computed.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

struct LineMinimum {
  Eigen::Vector4d delta;
  double cost;
  Eigen::Matrix4d hessian;  ///< half of it
};

/// The cost of a factor's line, all else standing fast at `state`.
template <typename Points>
class LineProblem {
 public:
  static constexpr int kMostSteps = 8;
  static constexpr double kLongestStep = 1.5;
  static constexpr double kConverged = 1e-3;

  LineProblem(const Geometry& geometry, const Points& points, State state, double information,
              const Eigen::Vector4d& prior)
      : geometry_(geometry),
        points_(points),
        state_(std::move(state)),
        information_(information),
        prior_(prior),
        value_(points.rows()),
        jacobian_(points.rows(), geometry.columns()) {}

  double cost(const Eigen::Vector4d& delta) {
    state_.line = delta;
    evaluate(geometry_, points_, state_, value_, nullptr);
    return sum_at(delta);
  }

  /// Levenberg-Marquardt.
  LineMinimum descend(const Eigen::Vector4d& start) {
    double damping = 1e-3;
    Linearized at = linearize(start);
    for (int step = 0; step < kMostSteps; ++step) {
      Eigen::Matrix4d damped = at.fit.hessian;
      damped.diagonal() *= 1.0 + damping;
      Eigen::Vector4d move = -damped.partialPivLu().solve(at.gradient);
      move *= std::min(1.0, kLongestStep / (move.norm() + 1e-12));
      const Linearized tried = linearize(at.fit.delta + move);
      const double gained = at.fit.cost - tried.fit.cost;
      if (!(gained > 0.0)) {
        damping *= 10.0;
        continue;
      }
      damping *= 0.2;
      at = tried;
      if (gained < kConverged * at.fit.cost) break;
    }
    return at.fit;
  }

 private:
  struct Linearized {
    LineMinimum fit;
    Eigen::Vector4d gradient;  ///< half of it
  };

  Linearized linearize(const Eigen::Vector4d& delta) {
    state_.line = delta;
    MatrixOut jacobian = jacobian_;
    evaluate(geometry_, points_, state_, value_, &jacobian);
    const auto by_line = jacobian_.template middleCols<4>(kLine);
    Eigen::Matrix4d hessian = information_ * (by_line.transpose() * by_line);
    hessian.diagonal() += prior_;
    const Eigen::Vector4d gradient =
        information_ * (by_line.transpose() * value_) + prior_.cwiseProduct(delta);
    return {{delta, sum_at(delta), hessian}, gradient};
  }

  /// Of the residual in `value_`.
  double sum_at(const Eigen::Vector4d& delta) const {
    return information_ * value_.squaredNorm() + prior_.dot(delta.cwiseAbs2());
  }

  const Geometry& geometry_;
  const Points& points_;
  State state_;
  double information_;
  Eigen::Vector4d prior_;
  Eigen::VectorXd value_;
  Eigen::MatrixXd jacobian_;
};

/// The best end of the descents from the `descents` best of `starts`.
template <typename Points>
LineMinimum fit_line(LineProblem<Points>& problem, const std::vector<Eigen::Vector4d>& starts,
                     std::size_t descents) {
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    // Without NaN, which has no place in an order.
    order.emplace_back(std::fmin(problem.cost(starts[i]), HUGE_VAL), i);
  }
  std::sort(order.begin(), order.end());
  LineMinimum best = problem.descend(starts[order[0].second]);
  for (std::size_t i = 1; i < std::min(descents, order.size()); ++i) {
    const LineMinimum other = problem.descend(starts[order[i].second]);
    if (other.cost < best.cost) best = other;
  }
  return best;
}

}  // namespace ruledgraph
