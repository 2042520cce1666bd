// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The stand-in's pointers (boost's in 4.2), vectors, keys and noise models.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

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
  struct Cauchy {
    static Shared<Cauchy> Create(double) { return Shared<Cauchy>(new Cauchy); }
  };
};

class Robust : public Base {
 public:
  explicit Robust(const Shared<Base>& noise) : Base(noise->dim()), noise_(noise) {}
  template <typename Loss>
  static Shared<Base> Create(const Shared<Loss>&, const Shared<Base>& noise) {
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

}  // namespace gtsam
