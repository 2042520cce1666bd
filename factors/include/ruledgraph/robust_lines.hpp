// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Normal equations of lines with a robust loss; needs Eigen alone. The native version of
// `ruledgraph_factors/robust_lines.py`, which says what is computed.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

/// The loss of one line's points, and half the gradient and Hessian of twice that.
struct RobustLine {
  double loss = 0.0;
  Eigen::MatrixXd information;  ///< by pose, velocity, bias, time (if any) and line
  Eigen::VectorXd gradient;
};

/// `precision` is one over a point's deviation; `scales` are the Cauchy constants, in deviations,
/// of each `chunk` frames.
template <typename Scales>
RobustLine robust_line(const Geometry& geometry, const GeometricPoints& points, const State& state,
                       double precision, Eigen::Index chunk, const Scales& scales,
                       bool want_equations) {
  const Eigen::Index rows = points.rows(), timed = geometry.timed() ? 1 : 0;
  Eigen::VectorXd value(rows);
  Eigen::MatrixXd jacobian;
  if (want_equations) {
    jacobian.resize(rows, geometry.columns());
    MatrixOut out = jacobian;
    evaluate(geometry, points, state, value, &out);
  } else {
    evaluate(geometry, points, state, value, nullptr);
  }
  value *= precision;

  RobustLine line;
  Eigen::VectorXd roots(rows);  // of the weights
  for (Eigen::Index i = 0, first = 0; first < rows; ++i, first += 3 * chunk) {
    const Eigen::Index count = std::min(3 * chunk, rows - first);
    const double square = scales[i] * scales[i];
    const double ratio = value.segment(first, count).squaredNorm() / square;
    line.loss += 0.5 * square * std::log1p(ratio);
    roots.segment(first, count).setConstant(1.0 / std::sqrt(1.0 + ratio));
  }
  if (!want_equations) return line;

  Eigen::MatrixXd weighted(rows, kGravity + timed + 4);
  weighted.leftCols<kGravity>() = jacobian.leftCols<kGravity>();
  if (timed != 0) weighted.col(kGravity) = jacobian.col(kTime);
  weighted.rightCols<4>() = jacobian.middleCols<4>(kLine);
  weighted.array().colwise() *= precision * roots.array();
  line.information.noalias() = weighted.transpose() * weighted;
  line.gradient.noalias() = weighted.transpose() * roots.cwiseProduct(value);
  return line;
}

}  // namespace ruledgraph
