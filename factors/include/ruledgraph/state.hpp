// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// What a factor depends on, and the motion from there to its frames; needs Eigen alone.
#pragma once

#include <Eigen/Core>
#include <stdexcept>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// What a factor depends on; SI units, world quantities unless said otherwise.
struct State {
  Matrix3 rotation;  ///< world_R_body of the state
  Vector3 position;
  Vector3 velocity;
  Vector6 bias;  ///< accelerometer, gyroscope; body
  Vector3 gravity;
  Eigen::Vector4d line;      ///< in the chart
  double time_shift = 0.0;   ///< how much later the frames were taken; of a timed geometry
  double focal_ratio = 1.0;  ///< of the camera to the one that points were normalised with
};

/// Preintegrated motion from the state to one frame.
struct FrameMotion {
  double elapsed;
  Vector6 preintegrated;                    ///< (theta, dp) at the bias integrated with
  Matrix6 bias_jacobian;                    ///< its derivative by the bias
  Vector6 time_jacobian = Vector6::Zero();  ///< and by the frame's time
};

/// (theta, dp) of a frame at a state, to first order; `bias` is the one integrated with, `timed`
/// says whether the motion knows its `time_jacobian`. Throws std::invalid_argument for a shift in
/// time of one that does not.
inline Vector6 corrected(const FrameMotion& motion, const State& state, const Vector6& bias,
                         bool timed) {
  Vector6 found = motion.preintegrated + motion.bias_jacobian * (state.bias - bias);
  if (timed) {
    found += motion.time_jacobian * state.time_shift;
  } else if (state.time_shift != 0.0) {
    throw std::invalid_argument("ruledgraph: time_shift: motions must be preintegrated with_time");
  }
  return found;
}

}  // namespace ruledgraph
