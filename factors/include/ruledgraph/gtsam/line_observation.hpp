// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// What the point-to-ruled-surface factors have in common.
#pragma once

#include <gtsam/geometry/Pose3.h>
#include <gtsam/geometry/Unit3.h>
#include <gtsam/navigation/ImuBias.h>
#include <gtsam/nonlinear/NonlinearFactor.h>

#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "ruledgraph/gtsam/compatibility.hpp"
#include "ruledgraph/gtsam/ruled_surface.hpp"

namespace ruledgraph {

/// Keys of what of the camera is a variable. In a factor they come in this order, before the
/// line's.
struct CameraKeys {
  /// `double`, s: how much later than its motions say the frames of a factor were taken, to first
  /// order; the motions know their derivative by time.
  std::optional<gtsam::Key> time{};
  /// `Pose3`, body_T_cam, in place of the one given.
  std::optional<gtsam::Key> extrinsics{};
  /// `double`: the camera's focal length over the one that points were normalised with.
  std::optional<gtsam::Key> focal{};
};

/// A factor that observes a line: the base of `RuledSurfaceFactor` and `RuledSurfacePoseFactor`.
class LineObservation : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;
  /// Its variables: a state (pose, velocity, bias), perhaps with gravity, or a pose; then those of
  /// the camera, and the line.
  enum class Form { kNode, kGravityDirection, kGravityVector, kPose };

  const RuledSurface& surface() const { return surface_; }
  Form form() const { return form_; }
  gtsam::Key line_key() const { return this->keys().back(); }

  /// The same observation of a line that has a new chart and key.
  virtual gtsam::NonlinearFactor::shared_ptr with_line(gtsam::Key line_key,
                                                       const LineChart& chart) const = 0;

  /// Its variables of the camera.
  CameraKeys camera() const {
    CameraKeys found;
    const gtsam::Key* next = this->keys().data() + (form_ == Form::kPose ? 1 : 3);
    if (has_time_) found.time = *next++;
    if (has_extrinsics_) found.extrinsics = *next++;
    if (has_focal_) found.focal = *next++;
    return found;
  }

  /// What the factor depends on, extrinsics apart.
  State state_at(const gtsam::Values& values) const {
    const auto& keys = this->keys();
    const auto& pose = values.at<gtsam::Pose3>(keys[0]);
    State state{
        pose.rotation().matrix(), pose.translation(), Vector3::Zero(),
        Vector6::Zero(),          gravity_,           values.at<gtsam::Vector4>(keys.back())};
    const CameraKeys camera = this->camera();
    if (camera.focal) state.focal_ratio = values.at<double>(*camera.focal);
    if (form_ == Form::kPose) return state;
    state.velocity = values.at<gtsam::Vector3>(keys[1]);
    state.bias = values.at<gtsam::imuBias::ConstantBias>(keys[2]).vector();
    if (camera.time) state.time_shift = values.at<double>(*camera.time);
    if (form_ == Form::kGravityVector) {
      state.gravity = values.at<gtsam::Vector3>(keys[3]);
    } else if (form_ == Form::kGravityDirection) {
      state.gravity = gravity_.norm() * values.at<gtsam::Unit3>(keys[3]).unitVector();
    }
    return state;
  }

  /// The geometry with the camera where the values have it.
  Geometry geometry_at(const gtsam::Values& values) const {
    if (!has_extrinsics_) return surface_.geometry();
    return surface_.with_camera(values.at<gtsam::Pose3>(*camera().extrinsics));
  }

  using Base::unwhitenedError;
  /// The residual; into H, if given, its derivatives by the variables in the order of the keys.
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    const State state = state_at(values);
    std::optional<gtsam::Pose3> body_T_cam;
    if (has_extrinsics_) body_T_cam = values.at<gtsam::Pose3>(*camera().extrinsics);
    RuledSurface::Derivatives found;
    const gtsam::Vector residual = surface_.evaluate(state, body_T_cam, H ? &found : nullptr);
    if (!H) return residual;
    const gtsam::Matrix& jacobian = found.jacobian;
    (*H)[0] = jacobian.middleCols<6>(kPose);
    H->back() = jacobian.middleCols<4>(kLine);
    if (form_ != Form::kPose) {
      (*H)[1] = jacobian.middleCols<3>(kVelocity);
      (*H)[2] = jacobian.middleCols<6>(kBias);
    }
    if (form_ == Form::kGravityVector) {
      (*H)[3] = jacobian.middleCols<3>(kGravity);
    } else if (form_ == Form::kGravityDirection) {
      const auto& direction = values.at<gtsam::Unit3>(this->keys()[3]);
      (*H)[3] = jacobian.middleCols<3>(kGravity) * (gravity_.norm() * direction.basis());
    }
    std::size_t of_camera = form_ == Form::kPose ? 1 : 3;
    if (has_time_) (*H)[of_camera++] = jacobian.col(kTime);
    if (has_extrinsics_) (*H)[of_camera++] = found.by_extrinsics;
    if (has_focal_) (*H)[of_camera++] = found.by_focal_ratio;
    return residual;
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const LineObservation*>(&other);
    return same != nullptr && Base::equals(other, tolerance) && form_ == same->form_ &&
           has_time_ == same->has_time_ && has_extrinsics_ == same->has_extrinsics_ &&
           has_focal_ == same->has_focal_ && (gravity_ - same->gravity_).norm() <= tolerance &&
           surface_.equals(same->surface_, tolerance);
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    const bool pose = form_ == Form::kPose;
    std::cout << s << (pose ? "RuledSurfacePoseFactor: " : "RuledSurfaceFactor: ")
              << surface_.geometry().frames() << " frames, " << surface_.rows() << " rows\n";
    Base::print("", key_formatter);
  }

 protected:
  LineObservation() = default;
  /// `keys` without the camera's and the line's.
  LineObservation(Form form, const gtsam::SharedNoiseModel& noise_model, gtsam::KeyVector keys,
                  const CameraKeys& camera, gtsam::Key line_key, RuledSurface surface,
                  const Vector3& gravity)
      : Base(noise_model, all(std::move(keys), camera, line_key)),
        surface_(std::move(surface)),
        form_(form),
        has_time_(camera.time.has_value()),
        has_extrinsics_(camera.extrinsics.has_value()),
        has_focal_(camera.focal.has_value()),
        gravity_(gravity) {
    surface_.check(noise_model);
    if (camera.time && form == Form::kPose) {
      throw std::invalid_argument("ruledgraph: a pose of its own has no time offset");
    }
    if (camera.time && !surface_.geometry().timed()) {
      throw std::invalid_argument("ruledgraph: motions must be preintegrated with_time");
    }
  }

  /// Of a copy.
  void move_line(gtsam::Key line_key, const LineChart& chart) {
    this->keys_.back() = line_key;
    surface_ = surface_.with_chart(chart);
  }

 private:
  static gtsam::KeyVector all(gtsam::KeyVector keys, const CameraKeys& camera,
                              gtsam::Key line_key) {
    for (const auto& key : {camera.time, camera.extrinsics, camera.focal}) {
      if (key) keys.push_back(*key);
    }
    keys.push_back(line_key);
    return keys;
  }

#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("NoiseModelFactor", boost::serialization::base_object<Base>(*this));
    int form = static_cast<int>(form_);
    archive& make_nvp("form", form);
    form_ = static_cast<Form>(form);
    archive& make_nvp("has_time", has_time_);
    archive& make_nvp("has_extrinsics", has_extrinsics_);
    archive& make_nvp("has_focal", has_focal_);
    archive& make_nvp("gravity", gravity_);
    archive& make_nvp("surface", surface_);
  }
#endif

  RuledSurface surface_;
  Form form_ = Form::kNode;
  bool has_time_ = false, has_extrinsics_ = false, has_focal_ = false;
  Vector3 gravity_ = Vector3::Zero();  ///< where it is a variable, its length alone counts
};

}  // namespace ruledgraph
