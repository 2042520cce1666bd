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
Key L(std::uint64_t j);
Key T(std::uint64_t j);
Key V(std::uint64_t j);
Key X(std::uint64_t j);

}  // namespace symbol_shorthand

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
