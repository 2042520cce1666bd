// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Declarations of the GTSAM classes that the example uses beside those of `standin.hpp`: enough to
// compile it, nothing to run.
#pragma once

#include "standin.hpp"

namespace gtsam {

namespace noiseModel {

struct Diagonal {
  static Shared<Base> Sigmas(const Vector& sigmas);
};

}  // namespace noiseModel

namespace symbol_shorthand {

Key B(std::uint64_t j);
Key E(std::uint64_t j);
Key F(std::uint64_t j);
Key L(std::uint64_t j);
Key P(std::uint64_t j);
Key T(std::uint64_t j);
Key V(std::uint64_t j);
Key X(std::uint64_t j);

}  // namespace symbol_shorthand

class NavState {
 public:
  NavState(const Rot3& attitude, const Point3& position, const Vector3& velocity);
  NavState(const Pose3& pose, const Vector3& velocity);
  Pose3 pose() const;
  Rot3 attitude() const;
  Point3 position() const;
  Vector3 velocity() const;
};

class Cal3_S2 {
 public:
  using shared_ptr = Shared<Cal3_S2>;
  Cal3_S2(double fx, double fy, double s, double u0, double v0);
};

template <class POSE, class LANDMARK, class CALIBRATION>
class GenericProjectionFactor : public NonlinearFactor {
 public:
  GenericProjectionFactor(const Point2& measured, const SharedNoiseModel& model, Key pose_key,
                          Key point_key, const Shared<CALIBRATION>& K, const POSE& body_P_sensor);
  shared_ptr clone() const override;
};

struct PreintegrationCombinedParams {
  static Shared<PreintegrationCombinedParams> MakeSharedU(double g);
  void setAccelerometerCovariance(const Matrix3& covariance);
  void setGyroscopeCovariance(const Matrix3& covariance);
  void setIntegrationCovariance(const Matrix3& covariance);
  Matrix3 biasAccCovariance, biasOmegaCovariance;
#if STANDIN_VERSION < 40300
  Eigen::Matrix<double, 6, 6> biasAccOmegaInt;
#endif
};

class PreintegratedCombinedMeasurements {
 public:
  PreintegratedCombinedMeasurements(const Shared<PreintegrationCombinedParams>& params,
                                    const imuBias::ConstantBias& bias);
  void integrateMeasurement(const Vector3& force, const Vector3& rate, double dt);
  NavState predict(const NavState& state, const imuBias::ConstantBias& bias) const;
};

class CombinedImuFactor : public NonlinearFactor {
 public:
  CombinedImuFactor(Key pose_i, Key velocity_i, Key pose_j, Key velocity_j, Key bias_i, Key bias_j,
                    const PreintegratedCombinedMeasurements& measurements);
  shared_ptr clone() const override;
};

class ISAM2 {
 public:
  explicit ISAM2(const ISAM2Params& params);
  void update(const NonlinearFactorGraph& factors = {}, const Values& values = {});
  Values calculateEstimate() const;
};

class LevenbergMarquardtOptimizer {
 public:
  LevenbergMarquardtOptimizer(const NonlinearFactorGraph& graph, const Values& initial,
                              const LevenbergMarquardtParams& params);
  const Values& optimize();
};

class Marginals {
 public:
  Marginals(const NonlinearFactorGraph& graph, const Values& solution);
  Matrix marginalCovariance(Key key) const;
};

}  // namespace gtsam
