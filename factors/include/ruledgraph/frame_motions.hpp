// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The motion of all frames after a state, from the IMU; needs Eigen alone. The C++ version of
// `FrameMotion` and `preintegrate_frames` in `ruledgraph_factors/motion.py`, where the equations
// are.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "ruledgraph/preintegration.hpp"
#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

/// Preintegrated motion from a state to each of n frames.
struct FrameMotions {
  std::vector<FrameMotion> frames;
  Vector6 bias = Vector6::Zero();  ///< integrated with: accelerometer (m/s^2), gyroscope (rad/s)
  bool timed = false;              ///< whether the frames know their `time_jacobian`

  /// No motion at all: one frame at the state itself.
  static FrameMotions at_rest() {
    return {{{0.0, Vector6::Zero(), Matrix6::Zero()}}, Vector6::Zero(), false};
  }

  /// Throws std::invalid_argument where there is no such frame.
  const FrameMotion& at(std::size_t frame) const {
    if (frame >= frames.size()) throw std::invalid_argument("ruledgraph: there is no such frame");
    return frames[frame];
  }

  /// The motion of some of the frames, for a line that is not seen in all of them. Throws
  /// std::invalid_argument for none, or some that there are not.
  FrameMotions select(const std::vector<std::size_t>& indices) const {
    if (indices.empty()) throw std::invalid_argument("ruledgraph: no frame is selected");
    FrameMotions chosen{{}, bias, timed};
    for (const std::size_t i : indices) chosen.frames.push_back(at(i));
    return chosen;
  }
};

/// Preintegrate the IMU from a state to every frame after it, linearised at `bias` (accelerometer,
/// gyroscope): the current estimate. Times are in s, those of the frames strictly increasing, the
/// first at or after the state; the samples cover them. With `with_time` the frames know how they
/// would move if they had been taken later. Throws std::invalid_argument for times that do not fit,
/// samples or a bias that are not finite, and where the body turns by more than pi.
inline FrameMotions preintegrate_frames(const ImuSamples& imu, double state_time,
                                        const std::vector<double>& frame_times, const Vector6& bias,
                                        bool with_time = false) {
  const auto require = [](bool condition, const char* message) {
    if (!condition) throw std::invalid_argument(message);
  };
  constexpr double kHalfTurn = 3.14159265358979323846;
  require(imu.times.size() >= 2, "ruledgraph: at least two IMU samples are needed");
  require(bias.allFinite(), "ruledgraph: the bias is not finite");
  require(!frame_times.empty(), "ruledgraph: no frame times");
  for (std::size_t i = 1; i < frame_times.size(); ++i) {
    require(frame_times[i] > frame_times[i - 1], "ruledgraph: frame times must increase");
  }
  require(frame_times.front() >= state_time - kSameTime,
          "ruledgraph: the first frame lies before the state");
  const double first = imu.times[0], last = imu.times[imu.times.size() - 1];
  require(state_time >= first - kSameTime && frame_times.back() <= last + kSameTime,
          "ruledgraph: the IMU samples do not cover the state and its frames");
  const auto covered = [&](double time) { return std::min(std::max(time, first), last); };
  std::vector<double> at_frames;
  for (const double time : frame_times) at_frames.push_back(covered(std::max(time, state_time)));
  std::vector<double> breaks = at_frames;
  breaks.push_back(covered(state_time));
  const ImuSegments segments = imu.segments(breaks, bias.head<3>(), bias.tail<3>());

  FrameMotions motions{{}, bias, with_time};
  Preintegrated motion;
  std::size_t done = 0;
  for (std::size_t j = 0; j < at_frames.size(); ++j) {
    for (; segments.breaks[done] < at_frames[j]; ++done) {
      const auto i = static_cast<Eigen::Index>(done);
      motion.integrate(segments.force.col(i) - bias.head<3>(),
                       segments.rate.col(i) - bias.tail<3>(),
                       segments.breaks[done + 1] - segments.breaks[done]);
      require(motion.delta.head<3>().norm() <= kHalfTurn,
              "ruledgraph: the body turns by more than half a turn; put a state in between");
    }
    FrameMotion frame{std::max(frame_times[j] - state_time, 0.0), motion.delta.head<6>(),
                      motion.d_bias.topRows<6>()};
    if (with_time) {
      // d theta / dt = Jr(theta)^-1 w, d dp / dt = dv
      const Vector3 rate = imu.at(at_frames[j]).second - bias.tail<3>();
      frame.time_jacobian << inverse_right_jacobian_action(motion.delta.head<3>(), rate).value,
          motion.delta.tail<3>();
    }
    motions.frames.push_back(frame);
  }
  return motions;
}

/// Pose of a frame from the state; times body_T_cam, its camera's. The state's line has no
/// part in it. Throws std::invalid_argument as `corrected` does, and where there is no such frame.
inline Pose frame_pose(const FrameMotions& motions, std::size_t frame, const State& state) {
  const FrameMotion& motion = motions.at(frame);
  const Vector6 delta = corrected(motion, state, motions.bias, motions.timed);
  const double t = motion.elapsed, shift = state.time_shift;
  return {state.rotation * exponential(delta.head<3>()).rotation,
          state.position + state.velocity * (t + shift) +
              state.gravity * (0.5 * t * t + t * shift) + state.rotation * delta.tail<3>()};
}

}  // namespace ruledgraph
