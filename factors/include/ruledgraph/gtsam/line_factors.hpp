// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Factors on a line beside its observations: the prior of a new line, its distance, and one line in
// two charts. The C++ versions of `new_line_factor`, `line_distance_factor` and `same_line_factor`
// in Python, where the equations are. Constructors throw std::invalid_argument.
#pragma once

#include <gtsam/geometry/Pose3.h>
#include <gtsam/linear/NoiseModel.h>
#include <gtsam/nonlinear/NonlinearFactor.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <stdexcept>
#include <string>

#include "ruledgraph/gtsam/compatibility.hpp"
#include "ruledgraph/gtsam/serialization.hpp"
#include "ruledgraph/line_coordinates.hpp"
#include "ruledgraph/line_distance.hpp"

namespace ruledgraph {

namespace detail {

inline void require_dimension(const gtsam::SharedNoiseModel& noise_model, std::size_t dimension) {
  if (!noise_model || noise_model->dim() != dimension) {
    throw std::invalid_argument("ruledgraph: the noise model must have dimension " +
                                std::to_string(dimension));
  }
}

inline bool same_chart(const LineChart& a, const LineChart& b, double tolerance) {
  const auto close = [&](const auto& one, const auto& other) {
    return (one - other).cwiseAbs().maxCoeff() <= tolerance;
  };
  return close(a.world_R_anchor, b.world_R_anchor) && close(a.world_t_anchor, b.world_t_anchor) &&
         close(a.basis, b.basis) && std::abs(a.angle - b.angle) <= tolerance;
}

}  // namespace detail

/// As seen from a pose, a line is about where its chart's reference is: r = delta - F xi, xi the
/// pose's coordinates at `world_T_body`. Noise model: dimension 4, such as `new_line_sigmas`.
///
/// The Jacobian by the pose is -F, a constant: exact at xi = 0 and off by a share of up to |xi| / 2
/// elsewhere, as it lacks Logmap's derivative. Beside so wide a prior that is nothing; a narrow one
/// would move the minimum.
class NewLineFactor : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;

  /// Of nothing, for serialisation.
  NewLineFactor() = default;
  NewLineFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                gtsam::Key line_key, const LineChart& chart, const gtsam::Pose3& world_T_body)
      : Base(noise_model, gtsam::KeyVector{pose_key, line_key}),
        chart_(chart),
        start_(world_T_body),
        by_pose_(-moved_with(chart, world_T_body)) {
    detail::require_dimension(noise_model, 4);
  }

  const LineChart& chart() const { return chart_; }

  using Base::unwhitenedError;
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    const gtsam::Vector6 moved = start_.localCoordinates(values.at<gtsam::Pose3>(keys()[0]));
    Wrapped at{values.at<gtsam::Vector4>(keys()[1]), Eigen::Matrix4d::Identity()};
    if (is_far(at.line)) at = wrapped(chart_, at.line);
    if (H) {
      (*H)[0] = by_pose_;
      (*H)[1] = at.by_line;
    }
    return at.line + by_pose_ * moved;
  }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new NewLineFactor(*this));
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const NewLineFactor*>(&other);
    return same != nullptr && Base::equals(other, tolerance) &&
           detail::same_chart(chart_, same->chart_, tolerance) &&
           (by_pose_ - same->by_pose_).cwiseAbs().maxCoeff() <= tolerance &&
           (start_.localCoordinates(same->start_)).norm() <= tolerance;
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    std::cout << s << "NewLineFactor\n";
    Base::print("", key_formatter);
  }

 private:
  /// F, the derivative of the reference line's coordinates when it moves with a pose.
  static Eigen::Matrix<double, 4, 6> moved_with(const LineChart& chart,
                                                const gtsam::Pose3& world_T_body) {
    const double sine = std::sin(chart.angle), cosine = std::cos(chart.angle);
    if (std::abs(cosine) < 1e-6) {
      throw std::invalid_argument("ruledgraph: the reference line runs through its anchor");
    }
    const Pose anchor_T_body = chart.world_T_anchor().inverse() * from_gtsam(world_T_body);
    Eigen::Matrix<double, 3, 6> by_turn, by_shift;
    by_turn << chart.basis.transpose() * anchor_T_body.rotation, Matrix3::Zero();
    by_shift << hat(anchor_T_body.position) * anchor_T_body.rotation, anchor_T_body.rotation;
    by_shift = (chart.basis.transpose() * by_shift).eval();
    Eigen::Matrix<double, 4, 6> moved;
    moved << sine * sine * by_shift.row(2), by_turn.row(0),
        by_turn.row(1) - sine / cosine * by_shift.row(0), by_turn.row(2);
    return moved;
  }

#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("NoiseModelFactor", boost::serialization::base_object<Base>(*this));
    archive& make_nvp("chart", chart_);
    archive& make_nvp("world_T_body", start_);
    archive& make_nvp("by_pose", by_pose_);
  }
#endif

  LineChart chart_;
  gtsam::Pose3 start_;
  Eigen::Matrix<double, 4, 6> by_pose_ = Eigen::Matrix<double, 4, 6>::Zero();
};

/// A line is about so far from a pose, give or take a factor: r = log(tan(phi) distance). Noise
/// model: dimension 1, of the logarithm of the distance.
class LineDistanceFactor : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;

  /// Of nothing, for serialisation.
  LineDistanceFactor() = default;
  LineDistanceFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                     gtsam::Key line_key, const LineChart& chart, double distance)
      : Base(noise_model, gtsam::KeyVector{pose_key, line_key}),
        chart_(chart),
        distance_(distance) {
    detail::require_dimension(noise_model, 1);
    if (!(distance > 0.0 && std::isfinite(distance))) {
      throw std::invalid_argument("ruledgraph: distance must be positive");
    }
  }

  const LineChart& chart() const { return chart_; }

  using Base::unwhitenedError;
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    const Pose pose = from_gtsam(values.at<gtsam::Pose3>(keys()[0]));
    const LineAngle phi =
        line_angle(chart_, values.at<gtsam::Vector4>(keys()[1]), pose.rotation, pose.position);
    // Beyond the logarithm's range it goes on straight.
    constexpr double kStraight = 0.05, kQuarterTurn = 0.5 * 3.14159265358979323846;
    const double inside = std::min(std::max(phi.value, kStraight), kQuarterTurn - kStraight);
    const double slope = 2.0 / std::sin(2.0 * inside);
    if (H) {
      (*H)[0] = slope * phi.pose;
      (*H)[1] = slope * phi.line;
    }
    return gtsam::Vector::Constant(
        1, std::log(std::tan(inside)) + std::log(distance_) + slope * (phi.value - inside));
  }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new LineDistanceFactor(*this));
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const LineDistanceFactor*>(&other);
    return same != nullptr && Base::equals(other, tolerance) &&
           detail::same_chart(chart_, same->chart_, tolerance) &&
           std::abs(distance_ - same->distance_) <= tolerance;
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    std::cout << s << "LineDistanceFactor: " << distance_ << " m\n";
    Base::print("", key_formatter);
  }

 private:
#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("NoiseModelFactor", boost::serialization::base_object<Base>(*this));
    archive& make_nvp("chart", chart_);
    archive& make_nvp("distance", distance_);
  }
#endif

  LineChart chart_;
  double distance_ = 1.0;
};

/// One line under two keys, in two charts: r = J (delta_old - delta) - delta_new, linear on
/// purpose, J of `reanchor` at `delta`. Noise model: dimension 4, |d|^2 / 2 (rad) where the
/// estimate has moved by d since the old variable was fixed. Throws, too, when the reference of
/// `new_chart` is another line.
class SameLineFactor : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;

  /// Of nothing, for serialisation.
  SameLineFactor() = default;
  SameLineFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key line_key,
                 gtsam::Key new_line_key, const LineChart& chart, const Vector4& delta,
                 const LineChart& new_chart)
      : Base(noise_model, gtsam::KeyVector{line_key, new_line_key}),
        chart_(chart),
        new_chart_(new_chart),
        delta_(delta),
        by_old_(by_old(chart, delta, new_chart)) {
    detail::require_dimension(noise_model, 4);
  }

  const LineChart& chart() const { return chart_; }
  const LineChart& new_chart() const { return new_chart_; }

  using Base::unwhitenedError;
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    if (H) {
      (*H)[0] = by_old_;
      (*H)[1] = -gtsam::Matrix::Identity(4, 4);
    }
    return by_old_ * (values.at<gtsam::Vector4>(keys()[0]) - delta_) -
           values.at<gtsam::Vector4>(keys()[1]);
  }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new SameLineFactor(*this));
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const SameLineFactor*>(&other);
    return same != nullptr && Base::equals(other, tolerance) &&
           detail::same_chart(chart_, same->chart_, tolerance) &&
           detail::same_chart(new_chart_, same->new_chart_, tolerance) &&
           (delta_ - same->delta_).norm() <= tolerance &&
           (by_old_ - same->by_old_).cwiseAbs().maxCoeff() <= tolerance;
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    std::cout << s << "SameLineFactor\n";
    Base::print("", key_formatter);
  }

 private:
  static Eigen::Matrix4d by_old(const LineChart& chart, const Vector4& delta,
                                const LineChart& new_chart) {
    constexpr double kSame = 1e-6;  // rounding, norm of the coordinates
    const Vector6 pair = plucker(chart, delta).value;
    if (!(local(new_chart, pair.head<3>(), pair.tail<3>()).norm() <= kSame)) {
      throw std::invalid_argument("ruledgraph: the new chart's reference is not this line");
    }
    const Reanchored same = reanchor(chart, delta, new_chart.world_T_anchor());
    // Its frame may have other signs, s: then w' = s w and phi' = s_1 s_2 phi.
    const Vector3 signs =
        (new_chart.basis.transpose() * same.chart.basis).diagonal().array().sign();
    return Vector4(signs[0] * signs[1], signs[0], signs[1], signs[2]).asDiagonal() * same.by_line;
  }

#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("NoiseModelFactor", boost::serialization::base_object<Base>(*this));
    archive& make_nvp("chart", chart_);
    archive& make_nvp("new_chart", new_chart_);
    archive& make_nvp("delta", delta_);
    archive& make_nvp("by_old", by_old_);
  }
#endif

  LineChart chart_, new_chart_;
  Vector4 delta_ = Vector4::Zero();
  Eigen::Matrix4d by_old_ = Eigen::Matrix4d::Zero();
};

}  // namespace ruledgraph
