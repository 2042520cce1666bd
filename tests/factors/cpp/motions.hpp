// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Tests of the IMU's samples, their preintegration, and frames that are shifted in time.
#pragma once

#include <Eigen/Core>
#include <cassert>
#include <cmath>
#include <limits>
#include <vector>

#include "ruledgraph/frame_motions.hpp"
#include "ruledgraph/ruled_surface.hpp"
#include "throws.hpp"

namespace ruledgraph {

inline double relative_error(const Eigen::MatrixXd& analytic, const Eigen::MatrixXd& numeric) {
  return (analytic - numeric).cwiseAbs().maxCoeff() / numeric.cwiseAbs().maxCoeff();
}

inline void preintegration_differentiates_by_the_bias() {
  const Eigen::MatrixXd force = 3.0 * Eigen::MatrixXd::Random(3, 30),
                        rate = Eigen::MatrixXd::Random(3, 30);
  const auto integrated = [&](const Eigen::VectorXd& bias) {
    Preintegrated motion;
    for (int i = 0; i < force.cols(); ++i) {
      motion.integrate(force.col(i) - bias.head<3>(), rate.col(i) - bias.tail<3>(), 0.05);
    }
    return motion;
  };
  Eigen::MatrixXd numeric(9, 6);
  const double step = 1e-5;
  for (int i = 0; i < 6; ++i) {
    const Eigen::VectorXd tangent = step * Eigen::VectorXd::Unit(6, i);
    numeric.col(i) = (integrated(tangent).delta - integrated(-tangent).delta) / (2.0 * step);
  }
  assert(relative_error(integrated(Eigen::VectorXd::Zero(6)).d_bias, numeric) < 1e-7);
}

/// Three samples, 0.1 s apart, at rest unless changed.
struct ThreeSamples {
  Eigen::Vector3d times{0.0, 0.1, 0.2};
  Matrix3 force = Matrix3::Zero(), rate = Matrix3::Zero();

  ImuSamples samples() const {
    return {{times.data(), 3}, {force.data(), 3, 3}, {rate.data(), 3, 3}};
  }
  bool refused(double start, const std::vector<double>& frames,
               const Vector6& bias = Vector6::Zero()) const {
    return throws([&] { preintegrate_frames(samples(), start, frames, bias); });
  }
};

inline void wrong_imu_samples_are_refused() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const ThreeSamples good;
  assert(!good.refused(0.0, {0.0, 0.2}));
  assert(good.refused(0.1, {0.0, 0.2}));
  assert(good.refused(0.0, {0.1, 0.1}));
  assert(good.refused(0.0, {0.1, 0.3}));
  assert(good.refused(0.0, {}));
  assert(good.refused(nan, {0.1}));
  assert(good.refused(0.0, {nan}));
  assert(good.refused(0.0, {0.1, infinity}));
  assert(good.refused(0.0, {0.1}, Vector6::Constant(nan)));

  ThreeSamples spinning;
  spinning.rate.setConstant(20.0);
  assert(spinning.refused(0.0, {0.2}));

  for (int i = 0; i < 3; ++i) {
    ThreeSamples broken;
    broken.times[i] = nan;
    assert(broken.refused(0.0, {0.2}));
    broken = ThreeSamples();
    broken.force(1, i) = nan;
    assert(broken.refused(0.0, {0.2}));
    broken = ThreeSamples();
    broken.rate(2, i) = infinity;
    assert(broken.refused(0.0, {0.2}));
  }
  ThreeSamples unsorted;
  unsorted.times = {0.2, 0.1, 0.0};
  assert(unsorted.refused(0.0, {0.2}));
  unsorted.times = {0.1, 0.0, 0.2};
  assert(unsorted.refused(0.1, {0.2}));
  unsorted.times = {0.0, 0.3, 0.2};
  assert(unsorted.refused(0.0, {0.2}));
  unsorted.times = {0.0, 0.0, 0.2};
  assert(unsorted.refused(0.0, {0.2}));

  // What is not used is not looked at.
  ThreeSamples later;
  later.force(0, 2) = nan;
  assert(!later.refused(0.0, {0.05}));

  ThreeSamples fewer;
  const ImuSamples two_forces{
      {fewer.times.data(), 3}, {fewer.force.data(), 3, 2}, {fewer.rate.data(), 3, 3}};
  const Vector3 none = Vector3::Zero();
  assert(throws([&] { two_forces.segments({0.0, 0.1}, none, none); }));
  assert(throws([&] { good.samples().segments({}, none, none); }));
  assert(throws([&] { good.samples().segments({0.0, 0.3}, none, none); }));
  assert(throws([&] { good.samples().segments({nan, 0.1}, none, none); }));
  assert(!throws([&] { good.samples().segments({0.0, 0.2}, none, none); }));
}

inline void shifts_in_time_take_motions_that_know_them() {
  const ThreeSamples imu;
  const std::vector<double> times{0.1, 0.2};
  const FrameMotions plain = preintegrate_frames(imu.samples(), 0.0, times, Vector6::Zero());
  const FrameMotions timed = preintegrate_frames(imu.samples(), 0.0, times, Vector6::Zero(), true);
  State state{Matrix3::Identity(), Vector3::Zero(), Vector3::UnitX(),
              Vector6::Zero(),     Vector3::Zero(), Eigen::Vector4d::Zero()};
  assert(!throws([&] { frame_pose(plain, 1, state); }));
  state.time_shift = 0.01;
  assert(throws([&] { frame_pose(plain, 1, state); }));
  // At 1 m/s.
  assert(std::abs(frame_pose(timed, 1, state).position.x() - 0.21) < 1e-12);

  Eigen::VectorXd residual(6);
  const GeometricPoints points{{Matrix3::Identity(), Matrix3::Identity()}};
  const LineChart chart{Matrix3::Identity(), Vector3::Zero(), Matrix3::Identity(), 0.5};
  for (const bool is_timed : {false, true}) {
    const FrameMotions& motions = is_timed ? timed : plain;
    const Geometry geometry(chart, Matrix3::Identity(), Vector3::Zero(), motions.frames,
                            motions.bias, motions.timed);
    assert(throws([&] { evaluate(geometry, points, state, residual, nullptr); }) == !is_timed);
  }

  assert(throws([&] { frame_pose(timed, 2, state); }));
  assert(throws([&] { timed.select({}); }));
  assert(throws([&] { timed.select({2}); }));
  assert(timed.select({1}).frames.size() == 1);
}

}  // namespace ruledgraph
