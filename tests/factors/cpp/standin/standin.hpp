// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// A stand-in, written for the tests, of the few GTSAM classes that ruledgraph's headers touch, with
// the interfaces of GTSAM 4.3 or, with STANDIN_VERSION 40200, of 4.2. It computes what the tests
// need: variables, retractions, unwhitened errors.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <any>
#include <iostream>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "noise.hpp"
#include "ruledgraph/so3.hpp"

namespace gtsam {

class Rot3 {
 public:
  Rot3() = default;
  explicit Rot3(const Matrix3& matrix) : matrix_(matrix) {}
  static Rot3 Expmap(const Vector3& v) { return Rot3(ruledgraph::exponential(v).rotation); }
  Matrix3 matrix() const { return matrix_; }

 private:
  friend class Pose3;
  Matrix3 matrix_ = Matrix3::Identity();
};

class Pose3 {
 public:
  Pose3() = default;
  Pose3(const Rot3& rotation, const Point3& translation)
      : rotation_(rotation), translation_(translation) {}
  const Rot3& rotation() const { return rotation_; }
  const Point3& translation() const { return translation_; }
  Pose3 operator*(const Pose3& other) const {
    const Matrix3 rotation = rotation_.matrix();
    return Pose3(Rot3(rotation * other.rotation_.matrix()),
                 rotation * other.translation_ + translation_);
  }
  /// Right perturbation by the exponential map, rotation first.
  Pose3 retract(const Vector6& v) const {
    return *this * Pose3(Rot3(ruledgraph::exponential(v.head<3>()).rotation),
                         left_jacobian(v.head<3>()) * v.tail<3>());
  }
  Point3 transformTo(const Point3& point) const {
    return rotation_.matrix().transpose() * (point - translation_);
  }
  Matrix matrix() const {
    Matrix whole = Matrix::Identity(4, 4);
    whole.topLeftCorner(3, 3) = rotation_.matrix();
    whole.topRightCorner(3, 1) = translation_;
    return whole;
  }
  Vector6 localCoordinates(const Pose3& other) const {
    const Matrix3 inverse = rotation_.matrix().transpose();
    const Vector3 turn = ruledgraph::logarithm(inverse * other.rotation_.matrix());
    Vector6 v;
    v << turn, left_jacobian(turn).inverse() * (inverse * (other.translation_ - translation_));
    return v;
  }
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    archive & rotation_.matrix_;
    archive & translation_;
  }

 private:
  static Matrix3 left_jacobian(const Vector3& v) {
    return ruledgraph::exponential(-v).right_jacobian;
  }
  Rot3 rotation_;
  Point3 translation_ = Point3::Zero();
};

class Unit3 {
 public:
  explicit Unit3(const Vector3& v) : vector_(v.normalized()) {}
  Vector3 unitVector() const { return vector_; }
  Matrix32 basis() const {
    const Vector3 first = vector_.unitOrthogonal();
    return (Matrix32() << first, vector_.cross(first)).finished();
  }
  Unit3 retract(const Vector2& v) const { return Unit3(vector_ + basis() * v); }

 private:
  Vector3 vector_;
};

namespace imuBias {

class ConstantBias {
 public:
  ConstantBias() = default;
  explicit ConstantBias(const Vector6& v) : vector_(v) {}
  Vector6 vector() const { return vector_; }

 private:
  Vector6 vector_ = Vector6::Zero();
};

}  // namespace imuBias

class Values {
 public:
  template <typename T>
  void insert(Key key, const T& value) {
    values_.emplace(key, value);
  }
  void insert(const Values& other) { values_.insert(other.values_.begin(), other.values_.end()); }
  template <typename T>
  void update(Key key, const T& value) {
    values_[key] = value;
  }
  template <typename T>
  const T at(Key key) const {
    return std::any_cast<T>(values_.at(key));
  }

 private:
  std::map<Key, std::any> values_;
};

class NonlinearFactor {
 public:
  using shared_ptr = Shared<NonlinearFactor>;

  NonlinearFactor() = default;
  explicit NonlinearFactor(KeyVector keys) : keys_(std::move(keys)) {}
  virtual ~NonlinearFactor() = default;
  const KeyVector& keys() const { return keys_; }
  virtual void print(const std::string& s = "",
                     const KeyFormatter& formatter = DefaultKeyFormatter) const {
    std::cout << s;
    for (const Key key : keys_) std::cout << " " << formatter(key);
    std::cout << "\n";
  }
  virtual bool equals(const NonlinearFactor& other, double = 1e-9) const {
    return keys_ == other.keys_;
  }
  virtual shared_ptr clone() const = 0;
  /// Nothing; the stand-in has no linear factors.
  void linearize(const Values&) const {}

 protected:
  KeyVector keys_;
};

#if STANDIN_VERSION < 40300
using JacobiansOut = boost::optional<std::vector<Matrix>&>;
#else
using OptionalMatrixVecType = std::vector<Matrix>*;
using JacobiansOut = OptionalMatrixVecType;
#endif

class NoiseModelFactor : public NonlinearFactor {
 public:
  NoiseModelFactor() = default;
  NoiseModelFactor(const SharedNoiseModel& noise_model, const KeyVector& keys)
      : NonlinearFactor(keys), noise_model_(noise_model) {}
  bool equals(const NonlinearFactor& other, double tolerance = 1e-9) const override {
    const auto* same = dynamic_cast<const NoiseModelFactor*>(&other);
    return same != nullptr && NonlinearFactor::equals(other, tolerance) &&
           noise_model_->dim() == same->noise_model_->dim();
  }
  virtual Vector unwhitenedError(const Values& values, JacobiansOut H = {}) const = 0;
#if STANDIN_VERSION >= 40300
  Vector unwhitenedError(const Values& values, std::vector<Matrix>& H) const {
    return unwhitenedError(values, &H);
  }
#endif
  const SharedNoiseModel& noiseModel() const { return noise_model_; }

  /// Keys and dimension: of a `Unit` model.
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    std::size_t dim = noise_model_ ? noise_model_->dim() : 0;
    archive & keys_;
    archive & dim;
    if (Archive::is_loading::value) noise_model_ = noiseModel::Unit::Create(dim);
  }

 private:
  SharedNoiseModel noise_model_;
};

using FactorIndices = std::vector<std::size_t>;

class NonlinearFactorGraph {
 public:
  template <typename Factor>
  void add(const Factor& factor) {
    factors_.push_back(factor.clone());
  }
  template <typename T>
  void addPrior(Key key, const T& prior, const SharedNoiseModel& model);
  void push_back(const NonlinearFactor::shared_ptr& factor) { factors_.push_back(factor); }
  void push_back(const NonlinearFactorGraph& other) {
    factors_.insert(factors_.end(), other.factors_.begin(), other.factors_.end());
  }
  auto begin() const { return factors_.begin(); }
  auto end() const { return factors_.end(); }
  std::size_t size() const { return factors_.size(); }
  const NonlinearFactor::shared_ptr& operator[](std::size_t i) const { return factors_[i]; }

 private:
  std::vector<NonlinearFactor::shared_ptr> factors_;
};

struct LevenbergMarquardtParams {
  void setDiagonalDamping(bool) {}
  void setlambdaUpperBound(double) {}
  void setRelativeErrorTol(double) {}
  void setAbsoluteErrorTol(double) {}
};

struct ISAM2DoglegParams {};

struct ISAM2Params {
  ISAM2DoglegParams optimizationParams;
  double relinearizeThreshold = 0.1;
  int relinearizeSkip = 10;
};

}  // namespace gtsam
