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
#include <string>
#include <utility>

#include "ruledgraph/gtsam/compatibility.hpp"
#include "ruledgraph/gtsam/ruled_surface.hpp"

namespace ruledgraph {

/// A factor that observes a line: the base of `RuledSurfaceFactor` and `RuledSurfacePoseFactor`.
/// The line's key is the last, an extra variable's the one before it.
class LineObservation : public gtsam::NoiseModelFactor {
 public:
  using Base = gtsam::NoiseModelFactor;
  /// Its variables: a state (pose, velocity, bias) or a pose, perhaps one more, and the line.
  enum class Form {
    kNode,
    kTimeOffset,
    kExtrinsics,
    kTimeOffsetExtrinsics,
    kGravityDirection,
    kGravityVector,
    kPose,
    kPoseExtrinsics,
  };

  const RuledSurface& surface() const { return surface_; }
  Form form() const { return form_; }
  gtsam::Key line_key() const { return this->keys().back(); }

  /// The same observation of a line that has a new chart and key.
  virtual gtsam::NonlinearFactor::shared_ptr with_line(gtsam::Key line_key,
                                                       const LineChart& chart) const = 0;

  /// What the factor depends on, extrinsics apart.
  State state_at(const gtsam::Values& values) const {
    const auto& keys = this->keys();
    const auto& pose = values.at<gtsam::Pose3>(keys[0]);
    State state{
        pose.rotation().matrix(), pose.translation(), Vector3::Zero(),
        Vector6::Zero(),          gravity_,           values.at<gtsam::Vector4>(keys.back())};
    if (form_ == Form::kPose || form_ == Form::kPoseExtrinsics) return state;
    state.velocity = values.at<gtsam::Vector3>(keys[1]);
    state.bias = values.at<gtsam::imuBias::ConstantBias>(keys[2]).vector();
    if (has_time_offset()) {
      state.time_shift = values.at<double>(keys[3]);
    } else if (form_ == Form::kGravityVector) {
      state.gravity = values.at<gtsam::Vector3>(keys[3]);
    } else if (form_ == Form::kGravityDirection) {
      state.gravity = gravity_.norm() * values.at<gtsam::Unit3>(keys[3]).unitVector();
    }
    return state;
  }

  /// The geometry with the camera where the values have it.
  Geometry geometry_at(const gtsam::Values& values) const {
    if (!has_extrinsics()) return surface_.geometry();
    return surface_.with_camera(values.at<gtsam::Pose3>(extra_key()));
  }

  using Base::unwhitenedError;
  /// The residual; into H, if given, its derivatives by the variables in the order of the keys.
  gtsam::Vector unwhitenedError(const gtsam::Values& values, JacobiansOut H = {}) const override {
    const State state = state_at(values);
    gtsam::Matrix jacobian, by_camera;
    gtsam::Matrix* const wanted = H ? &jacobian : nullptr;
    gtsam::Vector residual;
    if (has_extrinsics()) {
      const auto& body_T_cam = values.at<gtsam::Pose3>(extra_key());
      residual = surface_.evaluate(state, body_T_cam, wanted, &by_camera);
    } else {
      residual = surface_.evaluate(state, wanted);
    }
    if (!H) return residual;
    (*H)[0] = jacobian.middleCols<6>(kPose);
    H->back() = jacobian.middleCols<4>(kLine);
    if (form_ != Form::kPose && form_ != Form::kPoseExtrinsics) {
      (*H)[1] = jacobian.middleCols<3>(kVelocity);
      (*H)[2] = jacobian.middleCols<6>(kBias);
    }
    if (has_time_offset()) (*H)[3] = jacobian.col(kTime);
    gtsam::Matrix& by_extra = (*H)[H->size() - 2];
    if (has_extrinsics()) {
      by_extra = by_camera;
    } else if (form_ == Form::kGravityVector) {
      by_extra = jacobian.middleCols<3>(kGravity);
    } else if (form_ == Form::kGravityDirection) {
      const auto& direction = values.at<gtsam::Unit3>(extra_key());
      by_extra = jacobian.middleCols<3>(kGravity) * (gravity_.norm() * direction.basis());
    }
    return residual;
  }

  bool equals(const gtsam::NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const LineObservation*>(&other);
    return same != nullptr && Base::equals(other, tolerance) && form_ == same->form_ &&
           (gravity_ - same->gravity_).norm() <= tolerance &&
           surface_.equals(same->surface_, tolerance);
  }

  void print(const std::string& s = "",
             const gtsam::KeyFormatter& key_formatter = gtsam::DefaultKeyFormatter) const override {
    const bool pose = form_ == Form::kPose || form_ == Form::kPoseExtrinsics;
    std::cout << s << (pose ? "RuledSurfacePoseFactor: " : "RuledSurfaceFactor: ")
              << surface_.geometry().frames() << " frames, " << surface_.rows() << " rows\n";
    Base::print("", key_formatter);
  }

 protected:
  LineObservation() = default;
  LineObservation(Form form, const gtsam::SharedNoiseModel& noise_model,
                  const gtsam::KeyVector& keys, RuledSurface surface, const Vector3& gravity)
      : Base(noise_model, keys), surface_(std::move(surface)), form_(form), gravity_(gravity) {
    surface_.check(noise_model);
  }

  /// Of a copy.
  void move_line(gtsam::Key line_key, const LineChart& chart) {
    this->keys_.back() = line_key;
    surface_ = surface_.with_chart(chart);
  }

 private:
  bool has_extrinsics() const {
    return form_ == Form::kExtrinsics || form_ == Form::kTimeOffsetExtrinsics ||
           form_ == Form::kPoseExtrinsics;
  }
  bool has_time_offset() const {
    return form_ == Form::kTimeOffset || form_ == Form::kTimeOffsetExtrinsics;
  }
  gtsam::Key extra_key() const { return this->keys()[this->keys().size() - 2]; }

#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("NoiseModelFactor", boost::serialization::base_object<Base>(*this));
    int form = static_cast<int>(form_);
    archive& make_nvp("form", form);
    form_ = static_cast<Form>(form);
    archive& make_nvp("gravity", gravity_);
    archive& make_nvp("surface", surface_);
  }
#endif

  RuledSurface surface_;
  Form form_ = Form::kNode;
  Vector3 gravity_ = Vector3::Zero();  ///< where it is a variable, its length alone counts
};

}  // namespace ruledgraph
