// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The points of a frame as sufficient statistics; needs Eigen alone. The native version of
// `GeometricPoints` in Python, which says what is computed.
#pragma once

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

/// Points in normalised coordinates, x and y side by side.
using PointRows = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

/// C, upper triangular: for any image line l, |C l|^2 = sum_i w_i (p_i . l)^2 with
/// p_i = (x_i, y_i, 1). It is the triangular factor of the QR decomposition of sqrt(w_i) p_i.
inline Matrix3 compress(const Eigen::Ref<const PointRows>& points,
                        const Eigen::Ref<const Eigen::VectorXd>& sqrt_weights) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, 3>;
  Rows rows(points.rows(), 3);
  rows.leftCols<2>() = points.array().colwise() * sqrt_weights.array();
  rows.col(2) = sqrt_weights;
  const Eigen::Index height = std::min<Eigen::Index>(points.rows(), 3);
  Matrix3 C = Matrix3::Zero();
  C.topRows(height) =
      Eigen::HouseholderQR<Rows>(rows).matrixQR().topRows(height).triangularView<Eigen::Upper>();
  return C;
}

}  // namespace ruledgraph
