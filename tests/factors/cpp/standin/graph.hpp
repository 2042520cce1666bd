// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Declarations of the GTSAM classes that the example uses beside those of `standin.hpp`: enough to
// compile it, nothing to run.
#pragma once

#include "standin.hpp"

namespace gtsam {

namespace noiseModel {

struct Isotropic {
  static Shared<Base> Sigma(std::size_t dim, double sigma);
};

struct Diagonal {
  static Shared<Base> Sigmas(const Vector& sigmas);
};

}  // namespace noiseModel

namespace symbol_shorthand {

Key B(std::uint64_t j);
Key L(std::uint64_t j);
Key T(std::uint64_t j);
Key V(std::uint64_t j);
Key X(std::uint64_t j);

}  // namespace symbol_shorthand

class NonlinearFactorGraph {
 public:
  template <typename Factor>
  void add(const Factor& factor) {
    factors_.push_back(factor.clone());
  }
  template <typename T>
  void addPrior(Key key, const T& prior, const SharedNoiseModel& model);

 private:
  std::vector<NonlinearFactor::shared_ptr> factors_;
};

struct LevenbergMarquardtParams {
  void setDiagonalDamping(bool flag);
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
