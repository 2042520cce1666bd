// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The IMU's samples in segments, and their tangent-space preintegration with its derivative by the
// bias: the native version of `ruledgraph_factors/integration.py`, where the equations are.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

#include "ruledgraph/so3.hpp"

namespace ruledgraph {

/// Times that differ by less are the same, s.
constexpr double kSameTime = 1e-6;

/// n stretches of constant measurement between n + 1 breaks; one column each.
struct ImuSegments {
  std::vector<double> breaks;
  Eigen::Matrix3Xd force, rate;
};

/// IMU samples in order of time, s, not owned: specific force (m/s^2) and rate (rad/s), a column a
/// sample.
struct ImuSamples {
  Eigen::Map<const Eigen::VectorXd> times;
  Eigen::Map<const Eigen::Matrix3Xd> force, rate;

  /// As `ImuSamples.segments` in Python; the samples must reach from the first break to the last.
  /// `breaks` may be in any order. Throws std::invalid_argument unless the samples in between are
  /// finite and in order of time.
  ImuSegments segments(std::vector<double> breaks, const Vector3& force_bias,
                       const Vector3& rate_bias) const {
    if (breaks.empty()) throw std::invalid_argument("ruledgraph: no times to break at");
    const auto [first, last] = std::minmax_element(breaks.begin(), breaks.end());
    const double start = *first, stop = *last;
    check(start, stop);
    const double* end = times.data() + times.size();
    const double* inside = std::upper_bound(times.data(), end, start);
    breaks.insert(breaks.end(), inside, std::lower_bound(inside, end, stop));
    std::sort(breaks.begin(), breaks.end());
    breaks.erase(std::unique(breaks.begin(), breaks.end()), breaks.end());
    const auto count = static_cast<Eigen::Index>(breaks.size()) - 1;
    ImuSegments found{std::move(breaks), Eigen::Matrix3Xd(3, count), Eigen::Matrix3Xd(3, count)};
    auto [force_before, rate_before] = at(found.breaks.front());
    for (Eigen::Index i = 0; i < count; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const auto [force_after, rate_after] = at(found.breaks[k + 1]);
      const double dt = found.breaks[k + 1] - found.breaks[k];
      found.rate.col(i) = 0.5 * (rate_before + rate_after);
      const Vector3 middle = 0.5 * (force_before + force_after);
      // From the middle of the segment to its start.
      const Vector3 half_turn = 0.5 * dt * (found.rate.col(i) - rate_bias);
      found.force.col(i) = exponential(half_turn).rotation * (middle - force_bias) + force_bias;
      force_before = force_after;
      rate_before = rate_after;
    }
    return found;
  }

  /// Force and rate at a time, interpolated linearly.
  std::pair<Vector3, Vector3> at(double time) const {
    const Eigen::Index i = before(time);
    const double share = (time - times[i]) / (times[i + 1] - times[i]);
    return {force.col(i) + share * (force.col(i + 1) - force.col(i)),
            rate.col(i) + share * (rate.col(i + 1) - rate.col(i))};
  }

 private:
  /// The first of the two samples that a time is interpolated between.
  Eigen::Index before(double time) const {
    const double* after = std::upper_bound(times.data(), times.data() + times.size(), time);
    return std::clamp<Eigen::Index>(after - times.data() - 1, 0, times.size() - 2);
  }

  /// The samples that are used from `start` to `stop`; of a long recording there are many more.
  void check(double start, double stop) const {
    const auto require = [](bool condition, const char* message) {
      if (!condition) throw std::invalid_argument(message);
    };
    const Eigen::Index count = times.size();
    require(count >= 2 && force.cols() == count && rate.cols() == count,
            "ruledgraph: there must be as many times, forces and rates, at least two");
    const Eigen::Index first = before(start), last = before(stop) + 1;
    // Of times that are not in order the search may end anywhere: their neighbours are looked at,
    // too. Comparisons with NaN are false.
    bool in_order = times[first] <= start + kSameTime && stop <= times[last] + kSameTime;
    const Eigen::Index end = std::min(last + 1, count - 1);
    for (Eigen::Index i = std::max<Eigen::Index>(first - 1, 0); i < end; ++i) {
      in_order &= times[i] < times[i + 1];
    }
    require(in_order,
            "ruledgraph: the IMU samples are not in order of time, or do not reach so far");
    require(force.middleCols(first, last - first + 1).allFinite() &&
                rate.middleCols(first, last - first + 1).allFinite(),
            "ruledgraph: an IMU sample is not finite");
  }
};

/// Motion since a state in its body frame, and its derivative by the bias.
struct Preintegrated {
  /// (theta, dp, dv).
  Eigen::Matrix<double, 9, 1> delta = Eigen::Matrix<double, 9, 1>::Zero();
  /// By the bias (accelerometer, gyroscope).
  Eigen::Matrix<double, 9, 6> d_bias = Eigen::Matrix<double, 9, 6>::Zero();

  /// One Euler step of `dt` s; force (m/s^2) and rate (rad/s) are constant in it and without bias.
  void integrate(const Vector3& force, const Vector3& rate, double dt) {
    const Exponential turn = exponential(delta.head<3>());
    const InverseRightJacobianAction spin = inverse_right_jacobian_action(delta.head<3>(), rate);
    const Vector3 acceleration = turn.rotation * force;

    const Eigen::Matrix<double, 3, 6> d_theta = d_bias.topRows<3>();
    Eigen::Matrix<double, 3, 6> d_acceleration =
        -(turn.rotation * hat(force) * turn.right_jacobian) * d_theta;
    d_acceleration.leftCols<3>() -= turn.rotation;
    Eigen::Matrix<double, 3, 6> d_rate = spin.d_theta * d_theta;
    d_rate.rightCols<3>() -= spin.inverse;

    // The position takes the velocity before the step, hence this order.
    delta.head<3>() += spin.value * dt;
    delta.segment<3>(3) += delta.tail<3>() * dt + acceleration * (0.5 * dt * dt);
    delta.tail<3>() += acceleration * dt;
    d_bias.topRows<3>() += d_rate * dt;
    d_bias.middleRows<3>(3) += d_bias.bottomRows<3>() * dt + d_acceleration * (0.5 * dt * dt);
    d_bias.bottomRows<3>() += d_acceleration * dt;
  }
};

}  // namespace ruledgraph
