// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Point-to-ruled-surface factors for GTSAM 4.2 and 4.3, header-only; CPP.md is the guide. The same
// factors as those of `ruledgraph_factors/factor.py`, on the same kernel: equations, units and
// arguments are explained there.
#pragma once

#include <stdexcept>
#include <utility>

#include "ruledgraph/gtsam/line_observation.hpp"

namespace ruledgraph {

/// Gravity in a world whose z is up, m/s^2.
constexpr double kStandardGravity = 9.81;

/// One line over all frames that follow a state, on the state and the line: `Pose3`
/// world_T_body, `Vector3` velocity, `imuBias::ConstantBias`, then gravity (`Unit3` or `Vector3`)
/// or what of the camera is a variable (`CameraKeys`), and last the line, `Vector4` in `chart`. The
/// noise model has dimension `rows()` of the points, its unit is
/// normalised image coordinates of one point. Constructors throw std::invalid_argument where sizes
/// do not fit.
class RuledSurfaceFactor : public LineObservation {
 public:
  /// Of nothing, for serialisation.
  RuledSurfaceFactor() = default;

  RuledSurfaceFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                     gtsam::Key velocity_key, gtsam::Key bias_key, gtsam::Key line_key,
                     const FrameMotions& motions, const LineChart& chart, Points points,
                     const gtsam::Pose3& body_T_cam = gtsam::Pose3(),
                     const Vector3& gravity = {0.0, 0.0, -kStandardGravity})
      : RuledSurfaceFactor(noise_model, pose_key, velocity_key, bias_key, line_key, motions, chart,
                           std::move(points), CameraKeys{}, body_T_cam, gravity) {}

  /// With what of the camera is a variable; `body_T_cam` is not used if its extrinsics are.
  RuledSurfaceFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                     gtsam::Key velocity_key, gtsam::Key bias_key, gtsam::Key line_key,
                     const FrameMotions& motions, const LineChart& chart, Points points,
                     const CameraKeys& camera, const gtsam::Pose3& body_T_cam = gtsam::Pose3(),
                     const Vector3& gravity = {0.0, 0.0, -kStandardGravity})
      : LineObservation(Form::kNode, noise_model, {pose_key, velocity_key, bias_key}, camera,
                        line_key, {chart, motions, std::move(points), body_T_cam}, gravity) {}

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
            {pose_key, velocity_key, bias_key, gravity_key},
            line_key,
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
            {pose_key, velocity_key, bias_key, gravity_key},
            line_key,
            {chart, motions, std::move(points), body_T_cam},
            Vector3::Zero()};
  }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new RuledSurfaceFactor(*this));
  }

  gtsam::NonlinearFactor::shared_ptr with_line(gtsam::Key line_key,
                                               const LineChart& chart) const override {
    auto* const copy = new RuledSurfaceFactor(*this);
    const gtsam::NonlinearFactor::shared_ptr owner(copy);
    copy->move_line(line_key, chart);
    return owner;
  }

 private:
  RuledSurfaceFactor(Form form, const gtsam::SharedNoiseModel& noise_model,
                     const gtsam::KeyVector& keys, gtsam::Key line_key, RuledSurface surface,
                     const Vector3& gravity)
      : LineObservation(form, noise_model, keys, {}, line_key, std::move(surface), gravity) {}

#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("LineObservation", boost::serialization::base_object<LineObservation>(*this));
  }
#endif
};

/// One line in one frame that has a pose of its own: `Pose3` world_T_body, or world_T_cam without
/// `body_T_cam`, and the line. `points` hold that one frame.
class RuledSurfacePoseFactor : public LineObservation {
 public:
  /// Of nothing, for serialisation.
  RuledSurfacePoseFactor() = default;

  RuledSurfacePoseFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                         gtsam::Key line_key, const LineChart& chart, Points points,
                         const gtsam::Pose3& body_T_cam = gtsam::Pose3())
      : RuledSurfacePoseFactor(noise_model, pose_key, line_key, chart, std::move(points),
                               CameraKeys{}, body_T_cam) {}

  /// With what of the camera is a variable; a pose is that of its frame and has no time.
  RuledSurfacePoseFactor(const gtsam::SharedNoiseModel& noise_model, gtsam::Key pose_key,
                         gtsam::Key line_key, const LineChart& chart, Points points,
                         const CameraKeys& camera, const gtsam::Pose3& body_T_cam = gtsam::Pose3())
      : LineObservation(Form::kPose, noise_model, {pose_key}, camera, line_key,
                        {chart, FrameMotions::at_rest(), std::move(points), body_T_cam},
                        Vector3::Zero()) {}

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return gtsam::NonlinearFactor::shared_ptr(new RuledSurfacePoseFactor(*this));
  }

  gtsam::NonlinearFactor::shared_ptr with_line(gtsam::Key line_key,
                                               const LineChart& chart) const override {
    auto* const copy = new RuledSurfacePoseFactor(*this);
    const gtsam::NonlinearFactor::shared_ptr owner(copy);
    copy->move_line(line_key, chart);
    return owner;
  }

 private:
#ifdef RULEDGRAPH_SERIALIZATION
  friend class boost::serialization::access;
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    using boost::serialization::make_nvp;
    archive& make_nvp("LineObservation", boost::serialization::base_object<LineObservation>(*this));
  }
#endif
};

}  // namespace ruledgraph
