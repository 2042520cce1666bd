// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The camera's pose in the body as a variable; needs Eigen alone. The C++ version of
// `by_extrinsics` in `ruledgraph_factors/evaluation.py`.
#pragma once

#include <Eigen/Core>

#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

/// Jacobian (rows x 6) by body_T_cam, right perturbation, rotation first, from that by the state's
/// pose (rows x 6), at a state. `geometry` has the camera where it is. With D = (Exp(theta), dp) a
/// frame's motion and E = body_T_cam, E Exp(w) moves its camera as X Exp(Ad(D E) w) does: a frame's
/// rows are those of the pose times Ad(D E).
template <typename Points>
Eigen::Matrix<double, Eigen::Dynamic, 6> by_extrinsics(
    const Geometry& geometry, const Points& points, const State& state,
    const Eigen::Ref<const Eigen::MatrixXd>& by_pose) {
  Eigen::Matrix<double, Eigen::Dynamic, 6> found(by_pose.rows(), 6);
  const Matrix3 body_R_cam = geometry.body_R_cam();
  Eigen::Index first = 0;
  for (std::size_t i = 0; i < geometry.frames(); ++i) {
    const Vector6 motion = geometry.corrected(i, state);
    const Matrix3 start_R_frame = exponential(motion.head<3>()).rotation;
    const Matrix3 turn = start_R_frame * body_R_cam;
    const Vector3 shift = motion.tail<3>() + start_R_frame * geometry.body_t_cam();
    Matrix6 adjoint = Matrix6::Zero();
    adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = turn;
    adjoint.bottomLeftCorner<3, 3>() = hat(shift) * turn;
    const Eigen::Index rows = points.rows_of(i);
    found.middleRows(first, rows).noalias() = by_pose.middleRows(first, rows) * adjoint;
    first += rows;
  }
  return found;
}

}  // namespace ruledgraph
