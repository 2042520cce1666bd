// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Point-to-ruled-surface factors for GTSAM 4.2 and 4.3, header-only; CPP.md is the guide. The same
// factors as those of `ruledgraph_factors/factor.py`, on the same kernel: equations, units and
// arguments are explained there.
#pragma once

#include <gtsam/geometry/Pose3.h>
#include <gtsam/geometry/Unit3.h>
#include <gtsam/navigation/ImuBias.h>
#include <gtsam/nonlinear/NonlinearFactor.h>

#include <iostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "ruledgraph/frame_motions.hpp"
#include "ruledgraph/gtsam/compatibility.hpp"
#include "ruledgraph/observations.hpp"
#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

/// A line's edge points; their type chooses the residual: the geometric one, three rows a frame, or
/// the reprojection error, two rows a point.
using Points = std::variant<GeometricPoints, ReprojectionPoints>;

/// Gravity in a world whose z is up, m/s^2.
constexpr double kStandardGravity = 9.81;

/// The constants that both factors share, and their arithmetic.
class RuledSurface {
 public:
  RuledSurface(const LineChart& chart, const FrameMotions& motions, Points points,
               const gtsam::Pose3& body_T_cam)
      : geometry_(chart, body_T_cam.rotation().matrix(), body_T_cam.translation(), motions.frames,
                  motions.bias, motions.timed),
        points_(std::move(points)) {}

  const Geometry& geometry() const { return geometry_; }
  const Points& points() const { return points_; }
  /// Of the residual: the dimension of the noise model.
  Eigen::Index rows() const {
    return std::visit([](const auto& points) { return points.rows(); }, points_);
  }

  /// Frames that the points are from.
  std::size_t frames_of_points() const {
    if (const auto* compressed = std::get_if<GeometricPoints>(&points_)) {
      return compressed->statistics.size();
    }
    return std::get<ReprojectionPoints>(points_).counts.size();
  }

  /// Unwhitened residual and, unless null, its Jacobian; the columns are those of `Geometry`.
  gtsam::Vector evaluate(const State& state, gtsam::Matrix* jacobian) const {
    gtsam::Vector residual(rows());
    const auto write = [&](MatrixOut* out) {
      std::visit(
          [&](const auto& points) {
            ruledgraph::evaluate(geometry_, points, state, residual, out);
          },
          points_);
    };
    if (jacobian == nullptr) {
      write(nullptr);
    } else {
      jacobian->resize(rows(), geometry_.columns());
      MatrixOut out(*jacobian);
      write(&out);
    }
    return residual;
  }

  bool equals(const RuledSurface& other, double tolerance) const {
    if (points_.index() != other.points_.index() || rows() != other.rows() ||
        !geometry_.equals(other.geometry_, tolerance)) {
      return false;
    }
    const auto close = [&](const auto& a, const auto& b) {
      return (a - b).cwiseAbs().maxCoeff() <= tolerance;
    };
    if (const auto* mine = std::get_if<GeometricPoints>(&points_)) {
      const auto& theirs = std::get<GeometricPoints>(other.points_).statistics;
      return std::equal(mine->statistics.begin(), mine->statistics.end(), theirs.begin(),
                        theirs.end(), close);
    }
    const auto& mine = std::get<ReprojectionPoints>(points_);
    const auto& theirs = std::get<ReprojectionPoints>(other.points_);
    return close(mine.points, theirs.points) && close(mine.sqrt_weights, theirs.sqrt_weights) &&
           mine.counts == theirs.counts;
  }

  /// Throws std::invalid_argument unless the noise model and the points fit.
  void check(const gtsam::SharedNoiseModel& noise_model) const {
    if (frames_of_points() != geometry_.frames()) {
      throw std::invalid_argument("ruledgraph: the points are not from the frames of the motion");
    }
    if (!noise_model || static_cast<Eigen::Index>(noise_model->dim()) != rows()) {
      throw std::invalid_argument("ruledgraph: the noise model must have dimension " +
                                  std::to_string(rows()));
    }
  }

  void print(const std::string& name) const {
    std::cout << name << ": " << geometry_.frames() << " frames, " << rows() << " rows\n";
  }

 private:
  Geometry geometry_;
  Points points_;
};

/// One line over all frames that follow a node, on the node's state and the line: `Pose3`
/// world_T_body, `Vector3` velocity, `imuBias::ConstantBias`, then, in the forms that have one, a
/// time offset (`double`) or gravity (`Unit3` or `Vector3`), and last the line, `Vector4` in
/// `chart`. The noise model has dimension `rows()` of the points, its unit is normalised image
/// coordinates of one point. Constructors throw std::invalid_argument where sizes do not fit.
class RuledSurfaceFactor : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;
  /// What is variable beside pose, velocity, bias and line.
  enum class Form { kNode, kTimeOffset, kGravityDirection, kGravityVector };

  RuledSurfaceFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                     gtsam::Key velocity_key, gtsam::Key bias_key, gtsam::Key line_key,
                     const FrameMotions& motions, const LineChart& chart, Points points,
                     const gtsam::Pose3& body_T_cam = gtsam::Pose3(),
                     const Vector3& gravity = {0.0, 0.0, -kStandardGravity})
      : RuledSurfaceFactor(Form::kNode, noise_model, {pose_key, velocity_key, bias_key, line_key},
                           {chart, motions, std::move(points), body_T_cam}, gravity) {}

  /// With a variable for how much later than `motions` says the frames were taken, s, to first
  /// order. The motions know their derivative by time.
  static RuledSurfaceFactor WithTimeOffset(const gtsam::SharedNoiseModel& noise_model,
                                           gtsam::Key pose_key, gtsam::Key velocity_key,
                                           gtsam::Key bias_key, gtsam::Key time_key,
                                           gtsam::Key line_key, const FrameMotions& motions,
                                           const LineChart& chart, Points points,
                                           const gtsam::Pose3& body_T_cam = gtsam::Pose3(),
                                           const Vector3& gravity = {0.0, 0.0, -kStandardGravity}) {
    if (!motions.timed) {
      throw std::invalid_argument("ruledgraph: motions must be preintegrated with_time");
    }
    return {Form::kTimeOffset,
            noise_model,
            {pose_key, velocity_key, bias_key, time_key, line_key},
            {chart, motions, std::move(points), body_T_cam},
            gravity};
  }

  /// With the direction of gravity, downwards, as a `Unit3`.
  static RuledSurfaceFactor WithGravityDirection(const gtsam::SharedNoiseModel& noise_model,
                                                 gtsam::Key pose_key, gtsam::Key velocity_key,
                                                 gtsam::Key bias_key, gtsam::Key gravity_key,
                                                 gtsam::Key line_key, const FrameMotions& motions,
                                                 const LineChart& chart, Points points,
                                                 const gtsam::Pose3& body_T_cam = gtsam::Pose3(),
                                                 double magnitude = kStandardGravity) {
    return {Form::kGravityDirection,
            noise_model,
            {pose_key, velocity_key, bias_key, gravity_key, line_key},
            {chart, motions, std::move(points), body_T_cam},
            Vector3(0.0, 0.0, -magnitude)};
  }

  /// With all of gravity as a `Vector3`, m/s^2.
  static RuledSurfaceFactor WithGravityVector(const gtsam::SharedNoiseModel& noise_model,
                                              gtsam::Key pose_key, gtsam::Key velocity_key,
                                              gtsam::Key bias_key, gtsam::Key gravity_key,
                                              gtsam::Key line_key, const FrameMotions& motions,
                                              const LineChart& chart, Points points,
                                              const gtsam::Pose3& body_T_cam = gtsam::Pose3()) {
    return {Form::kGravityVector,
            noise_model,
            {pose_key, velocity_key, bias_key, gravity_key, line_key},
            {chart, motions, std::move(points), body_T_cam},
            Vector3::Zero()};
  }

  const RuledSurface& surface() const { return surface_; }

  using Base::unwhitenedError;
  /// The residual; into H, if given, its derivatives by the variables in the order of the keys.
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    const auto& keys = this->keys();
    const auto& pose = values.at<gtsam::Pose3>(keys[0]);
    State state{pose.rotation().matrix(),
                pose.translation(),
                values.at<gtsam::Vector3>(keys[1]),
                values.at<gtsam::imuBias::ConstantBias>(keys[2]).vector(),
                gravity_,
                values.at<gtsam::Vector4>(keys.back())};
    gtsam::Matrix gravity_by_variable = Matrix3::Identity();
    if (form_ == Form::kTimeOffset) {
      state.time_shift = values.at<double>(keys[3]);
    } else if (form_ == Form::kGravityVector) {
      state.gravity = values.at<gtsam::Vector3>(keys[3]);
    } else if (form_ == Form::kGravityDirection) {
      const auto& direction = values.at<gtsam::Unit3>(keys[3]);
      state.gravity = gravity_.norm() * direction.unitVector();
      gravity_by_variable = gravity_.norm() * direction.basis();
    }
    if (!H) return surface_.evaluate(state, nullptr);
    gtsam::Matrix jacobian;
    const gtsam::Vector residual = surface_.evaluate(state, &jacobian);
    (*H)[0] = jacobian.middleCols<6>(kPose);
    (*H)[1] = jacobian.middleCols<3>(kVelocity);
    (*H)[2] = jacobian.middleCols<6>(kBias);
    if (form_ == Form::kTimeOffset) {
      (*H)[3] = jacobian.col(kTime);
    } else if (form_ != Form::kNode) {
      (*H)[3] = jacobian.middleCols<3>(kGravity) * gravity_by_variable;
    }
    H->back() = jacobian.middleCols<4>(kLine);
    return residual;
  }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new RuledSurfaceFactor(*this));
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const RuledSurfaceFactor*>(&other);
    return same != nullptr && Base::equals(other, tolerance) && form_ == same->form_ &&
           (gravity_ - same->gravity_).norm() <= tolerance &&
           surface_.equals(same->surface_, tolerance);
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    surface_.print(s + "RuledSurfaceFactor");
    Base::print("", key_formatter);
  }

 private:
  RuledSurfaceFactor(Form form, const gtsam::SharedNoiseModel& noise_model,
                     const gtsam::KeyVector& keys, RuledSurface surface, const Vector3& gravity)
      : Base(noise_model, keys), surface_(std::move(surface)), form_(form), gravity_(gravity) {
    surface_.check(noise_model);
  }

  RuledSurface surface_;
  Form form_;
  Vector3 gravity_;  ///< where it is a variable, its length alone counts
};

/// One line in one frame that has a pose of its own: `Pose3` world_T_body, or world_T_cam without
/// `body_T_cam`, and the line. `points` hold that one frame.
class RuledSurfacePoseFactor : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;

  RuledSurfacePoseFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                         gtsam::Key line_key, const LineChart& chart, Points points,
                         const gtsam::Pose3& body_T_cam = gtsam::Pose3())
      : Base(noise_model, gtsam::KeyVector{pose_key, line_key}),
        surface_(chart, FrameMotions::at_rest(), std::move(points), body_T_cam) {
    surface_.check(noise_model);
  }

  const RuledSurface& surface() const { return surface_; }

  using Base::unwhitenedError;
  /// As `RuledSurfaceFactor::unwhitenedError`.
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    const auto& pose = values.at<gtsam::Pose3>(keys()[0]);
    const State state{pose.rotation().matrix(), pose.translation(),
                      Vector3::Zero(),          Vector6::Zero(),
                      Vector3::Zero(),          values.at<gtsam::Vector4>(keys()[1])};
    if (!H) return surface_.evaluate(state, nullptr);
    gtsam::Matrix jacobian;
    const gtsam::Vector residual = surface_.evaluate(state, &jacobian);
    (*H)[0] = jacobian.middleCols<6>(kPose);
    (*H)[1] = jacobian.middleCols<4>(kLine);
    return residual;
  }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new RuledSurfacePoseFactor(*this));
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const RuledSurfacePoseFactor*>(&other);
    return same != nullptr && Base::equals(other, tolerance) &&
           surface_.equals(same->surface_, tolerance);
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    surface_.print(s + "RuledSurfacePoseFactor");
    Base::print("", key_formatter);
  }

 private:
  RuledSurface surface_;
};

}  // namespace ruledgraph
