// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// What differs between GTSAM 4.2 (boost) and 4.3 (std), and conversions to and from its types.
//
// RULEDGRAPH_SERIALIZATION is defined where GTSAM has serialisation: always in 4.2, and in 4.3
// where the compiler is told GTSAM_ENABLE_BOOST_SERIALIZATION, as GTSAM's own headers ask for.
#pragma once

#include <gtsam/config.h>
#include <gtsam/geometry/Pose3.h>
#include <gtsam/navigation/ImuBias.h>
#include <gtsam/nonlinear/NonlinearFactor.h>

#include <vector>

#include "ruledgraph/ruled_surface.hpp"

#if GTSAM_VERSION_NUMERIC < 40300 || defined(GTSAM_ENABLE_BOOST_SERIALIZATION)
#define RULEDGRAPH_SERIALIZATION
#endif

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

/// What `frame_pose` takes.
inline State state_of(const gtsam::Pose3& world_T_body, const gtsam::Vector3& velocity,
                      const gtsam::imuBias::ConstantBias& bias,
                      const Vector3& gravity = {0.0, 0.0, -9.81}) {
  return {world_T_body.rotation().matrix(),
          world_T_body.translation(),
          velocity,
          bias.vector(),
          gravity,
          Vector4::Zero()};
}

}  // namespace ruledgraph
