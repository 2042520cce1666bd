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
#include <cmath>
#include <cstdint>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ruledgraph/so3.hpp"

#define GTSAM_VERSION_NUMERIC STANDIN_VERSION

#if STANDIN_VERSION < 40300
namespace boost {

struct none_t {};
constexpr none_t none{};

template <typename T>
class optional;

/// To a reference, the only kind that GTSAM's interface has here.
template <typename T>
class optional<T&> {
 public:
  optional() = default;
  optional(none_t) {}
  optional(T& value) : value_(&value) {}
  explicit operator bool() const { return value_ != nullptr; }
  T& operator*() const { return *value_; }
  T* operator->() const { return value_; }

 private:
  T* value_ = nullptr;
};

/// Not a std::shared_ptr, nor made from one.
template <typename T>
class shared_ptr {
 public:
  shared_ptr() = default;
  template <typename Derived>
  explicit shared_ptr(Derived* owned) : owner_(owned) {}
  template <typename Derived>
  shared_ptr(const shared_ptr<Derived>& other) : owner_(other.owner_) {}
  explicit operator bool() const { return owner_ != nullptr; }
  T& operator*() const { return *owner_; }
  T* operator->() const { return owner_.get(); }

 private:
  template <typename Other>
  friend class shared_ptr;
  std::shared_ptr<T> owner_;
};

}  // namespace boost
#endif

namespace gtsam {

#if STANDIN_VERSION < 40300
template <typename T>
using Shared = boost::shared_ptr<T>;
#else
template <typename T>
using Shared = std::shared_ptr<T>;
#endif

using Vector = Eigen::VectorXd;
using Vector2 = Eigen::Vector2d;
using Vector3 = Eigen::Vector3d;
using Vector4 = Eigen::Vector4d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix = Eigen::MatrixXd;
using Matrix3 = Eigen::Matrix3d;
using Matrix32 = Eigen::Matrix<double, 3, 2>;
using Point2 = Vector2;
using Point3 = Vector3;

using Key = std::uint64_t;
using KeyVector = std::vector<Key>;
using KeyFormatter = std::function<std::string(Key)>;
inline const KeyFormatter DefaultKeyFormatter = [](Key key) { return std::to_string(key); };

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

namespace noiseModel {

/// Of one standard deviation.
class Base {
 public:
  explicit Base(std::size_t dim, double sigma = 1.0) : dim_(dim), sigma_(sigma) {}
  virtual ~Base() = default;
  std::size_t dim() const { return dim_; }
  virtual Vector whiten(const Vector& v) const { return v / sigma_; }

 private:
  std::size_t dim_;
  double sigma_;
};

struct Unit {
  static Shared<Base> Create(std::size_t dim) { return Shared<Base>(new Base(dim)); }
};

struct Isotropic {
  static Shared<Base> Sigma(std::size_t dim, double sigma) {
    return Shared<Base>(new Base(dim, sigma));
  }
};

struct mEstimator {
  struct Huber {
    static Shared<Huber> Create(double) { return Shared<Huber>(new Huber); }
  };
};

class Robust : public Base {
 public:
  explicit Robust(const Shared<Base>& noise) : Base(noise->dim()), noise_(noise) {}
  static Shared<Base> Create(const Shared<mEstimator::Huber>&, const Shared<Base>& noise) {
    return Shared<Base>(new Robust(noise));
  }
  const Shared<Base>& noise() const { return noise_; }
  /// Weighs, too.
  Vector whiten(const Vector& v) const override { return 0.5 * noise_->whiten(v); }

 private:
  Shared<Base> noise_;
};

}  // namespace noiseModel

using SharedNoiseModel = Shared<noiseModel::Base>;

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
