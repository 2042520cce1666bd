// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The points of a frame as sufficient statistics; needs Eigen alone. The native version of
// `GeometricPoints` in Python, which says what is computed.
#pragma once

#include <Eigen/Core>
#include <Eigen/Householder>
#include <algorithm>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

/// Points in normalised coordinates, x and y side by side.
using PointRows = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

namespace detail {

/// The triangular factor of the QR decomposition of `rows`, which it overwrites.
///
/// Reflection by reflection, as `Eigen::HouseholderQR` does for so few columns; with it the
/// compiler would make the blocked products of large matrices, which takes it many seconds.
template <typename Rows>
Matrix3 triangular_factor(Rows& rows) {
  const Eigen::Index height = std::min<Eigen::Index>(rows.rows(), 3);
  double workspace[3], tau = 0.0, beta = 0.0;
  for (Eigen::Index k = 0; k < height; ++k) {
    const Eigen::Index below = rows.rows() - k;
    rows.col(k).tail(below).makeHouseholderInPlace(tau, beta);
    rows(k, k) = beta;
    rows.bottomRightCorner(below, 2 - k)
        .applyHouseholderOnTheLeft(rows.col(k).tail(below - 1), tau, workspace);
  }
  Matrix3 factor = Matrix3::Zero();
  factor.topRows(height) = rows.topRows(height).template triangularView<Eigen::Upper>();
  return factor;
}

}  // namespace detail

/// C, upper triangular: for any image line l, |C l|^2 = sum_i w_i (p_i . l)^2 with
/// p_i = (x_i, y_i, 1). It is the triangular factor of the QR decomposition of sqrt(w_i) p_i.
inline Matrix3 compress(const Eigen::Ref<const PointRows>& points,
                        const Eigen::Ref<const Eigen::VectorXd>& sqrt_weights) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, 3>;
  Rows rows(points.rows(), 3);
  rows.leftCols<2>() = points.array().colwise() * sqrt_weights.array();
  rows.col(2) = sqrt_weights;
  return detail::triangular_factor(rows);
}

}  // namespace ruledgraph
