// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// What differs between GTSAM 4.2 (boost) and 4.3 (std), and conversions to and from its types.
#pragma once

#include <gtsam/config.h>
#include <gtsam/geometry/Pose3.h>
#include <gtsam/nonlinear/NonlinearFactor.h>

#include <vector>

#include "ruledgraph/line_chart.hpp"

namespace ruledgraph {

#if GTSAM_VERSION_NUMERIC >= 40300
using JacobiansOut = gtsam::OptionalMatrixVecType;
#else
using JacobiansOut = boost::optional<std::vector<gtsam::Matrix>&>;
#endif

inline Pose from_gtsam(const gtsam::Pose3& pose) {
  return {pose.rotation().matrix(), pose.translation()};
}

inline gtsam::Pose3 to_gtsam(const Pose& pose) {
  return gtsam::Pose3(gtsam::Rot3(pose.rotation), pose.position);
}

}  // namespace ruledgraph
