// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The GTSAM factors in C++, against a real GTSAM or the stand-in beside this file. Reads factors
// and the point to evaluate them at from standard input (`test_cpp_factors.py` writes them), checks
// Jacobians numerically, clone, equals and print, and writes residuals and Jacobians.

#undef NDEBUG
#include <cassert>
#include <cstdio>
#include <iostream>
#include <sstream>

#include "ruledgraph/gtsam/ruled_surface_factor.hpp"
#include "stream.hpp"
#include "throws.hpp"

namespace {

using namespace ruledgraph;
using gtsam::Key;
using gtsam::Matrix;
using gtsam::Values;
using gtsam::Vector;

constexpr Key kPoseKey = 0, kVelocityKey = 1, kBiasKey = 2, kExtraKey = 3, kLineKey = 4;

enum Kind { kNode, kTimeOffset, kGravityDirection, kGravityVector, kPoseOnly };

gtsam::Pose3 read_pose() {
  const Pose pose = read_plain_pose();
  return to_gtsam(pose);
}

struct Case {
  Kind kind;
  gtsam::NonlinearFactor::shared_ptr factor;
  Values values;
};

gtsam::NonlinearFactor::shared_ptr make_factor(Kind kind, const FrameMotions& motions,
                                               const LineChart& chart, const Points& points,
                                               const gtsam::Pose3& body_T_cam,
                                               const Vector3& gravity) {
  const Eigen::Index rows = std::visit([](const auto& p) { return p.rows(); }, points);
  const auto noise = gtsam::noiseModel::Unit::Create(static_cast<std::size_t>(rows));
  const Key x = kPoseKey, v = kVelocityKey, b = kBiasKey, e = kExtraKey, l = kLineKey;
  using Factor = RuledSurfaceFactor;
  switch (kind) {
    case kNode:
      return Factor(noise, x, v, b, l, motions, chart, points, body_T_cam, gravity).clone();
    case kTimeOffset:
      return Factor::WithTimeOffset(noise, x, v, b, e, l, motions, chart, points, body_T_cam,
                                    gravity)
          .clone();
    case kGravityDirection:
      return Factor::WithGravityDirection(noise, x, v, b, e, l, motions, chart, points, body_T_cam,
                                          gravity.norm())
          .clone();
    case kGravityVector:
      return Factor::WithGravityVector(noise, x, v, b, e, l, motions, chart, points, body_T_cam)
          .clone();
    case kPoseOnly:
      return RuledSurfacePoseFactor(noise, x, l, chart, points, body_T_cam).clone();
  }
  throw std::logic_error("no such kind");
}

Case read_case(Kind kind) {
  const LineChart chart = read_chart();
  const gtsam::Pose3 body_T_cam = read_pose();
  const FrameMotions motions = read_motions();
  const bool compressed = read_number() != 0.0;
  const std::vector<PointRows> frames = read_frames();
  const Points points = compressed ? Points(compress_points(frames)) : individual_points(frames);
  const Vector3 gravity = read_fixed<3>();

  Case found{kind, make_factor(kind, motions, chart, points, body_T_cam, gravity), Values()};
  found.values.insert(kPoseKey, read_pose());
  found.values.insert(kVelocityKey, gtsam::Vector3(read_fixed<3>()));
  found.values.insert(kBiasKey, gtsam::imuBias::ConstantBias(read_fixed<6>()));
  found.values.insert(kLineKey, gtsam::Vector4(read_fixed<4>()));
  if (kind == kTimeOffset) found.values.insert(kExtraKey, read_number());
  if (kind == kGravityDirection) found.values.insert(kExtraKey, gtsam::Unit3(read_fixed<3>()));
  if (kind == kGravityVector) found.values.insert(kExtraKey, gtsam::Vector3(read_fixed<3>()));
  return found;
}

/// The values with one of them moved along its tangent.
Values moved(const Case& at, Key key, const Vector& tangent) {
  Values values = at.values;
  if (key == kPoseKey) {
    values.update(key, gtsam::Pose3(values.at<gtsam::Pose3>(key).retract(tangent)));
  } else if (key == kBiasKey) {
    const gtsam::Vector6 bias = values.at<gtsam::imuBias::ConstantBias>(key).vector() + tangent;
    values.update(key, gtsam::imuBias::ConstantBias(bias));
  } else if (key == kLineKey) {
    values.update(key, gtsam::Vector4(values.at<gtsam::Vector4>(key) + tangent));
  } else if (key == kExtraKey && at.kind == kTimeOffset) {
    values.update(key, values.at<double>(key) + tangent[0]);
  } else if (key == kExtraKey && at.kind == kGravityDirection) {
    values.update(key, values.at<gtsam::Unit3>(key).retract(tangent));
  } else {
    values.update(key, gtsam::Vector3(values.at<gtsam::Vector3>(key) + tangent));
  }
  return values;
}

const gtsam::NoiseModelFactor& with_error(const Case& at) {
  return dynamic_cast<const gtsam::NoiseModelFactor&>(*at.factor);
}

void check_jacobians(const Case& at, const std::vector<Matrix>& analytic) {
  const double step = 1e-5;
  for (std::size_t i = 0; i < analytic.size(); ++i) {
    const Key key = at.factor->keys()[i];
    Matrix numeric(analytic[i].rows(), analytic[i].cols());
    for (Eigen::Index j = 0; j < numeric.cols(); ++j) {
      const Vector tangent = step * Vector::Unit(numeric.cols(), j);
      numeric.col(j) = (with_error(at).unwhitenedError(moved(at, key, tangent)) -
                        with_error(at).unwhitenedError(moved(at, key, -tangent))) /
                       (2.0 * step);
    }
    const double scale = std::max(numeric.cwiseAbs().maxCoeff(), 1e-3);
    assert((analytic[i] - numeric).cwiseAbs().maxCoeff() < 1e-6 * scale);
  }
}

std::string printed(const gtsam::NonlinearFactor& factor) {
  const std::ostringstream text;
  auto* const before = std::cout.rdbuf(text.rdbuf());
  factor.print("one ");
  std::cout.rdbuf(before);
  return text.str();
}

void sizes_are_checked() {
  const LineChart chart = LineChart{Matrix3::Identity(), Vector3::Zero(), Matrix3::Identity(), 0.5};
  const GeometricPoints one{{Matrix3::Identity()}}, two{{Matrix3::Identity(), Matrix3::Identity()}};
  const auto noise = [](std::size_t dim) { return gtsam::noiseModel::Unit::Create(dim); };
  const FrameMotions rest = FrameMotions::at_rest();
  assert(!throws([&] { RuledSurfacePoseFactor(noise(3), 0, 1, chart, one); }));
  assert(throws([&] { RuledSurfacePoseFactor(noise(2), 0, 1, chart, one); }));
  assert(throws([&] { RuledSurfacePoseFactor(noise(6), 0, 1, chart, two); }));
  assert(throws([&] { RuledSurfaceFactor(noise(6), 0, 1, 2, 3, rest, chart, two); }));
  assert(throws([&] { RuledSurfaceFactor(noise(2), 0, 1, 2, 3, rest, chart, one); }));
  assert(throws(
      [&] { RuledSurfaceFactor::WithTimeOffset(noise(3), 0, 1, 2, 3, 4, rest, chart, one); }));
}

}  // namespace

int main() {
  sizes_are_checked();
  std::vector<Case> cases;
  for (double kind; std::cin >> kind;) cases.push_back(read_case(static_cast<Kind>(kind)));
  for (const Case& at : cases) {
    std::vector<Matrix> jacobians(at.factor->keys().size());
    const Vector residual = with_error(at).unwhitenedError(at.values, jacobians);
    assert(residual == with_error(at).unwhitenedError(at.values));
    check_jacobians(at, jacobians);
    assert(at.factor->clone()->equals(*at.factor));
    for (const Case& other : cases) {
      assert(at.factor->equals(*other.factor) == (&at == &other));
    }
    const std::string name =
        at.kind == kPoseOnly ? "one RuledSurfacePoseFactor: " : "one RuledSurfaceFactor: ";
    assert(printed(*at.factor).rfind(name, 0) == 0);
    write(residual);
    for (const Matrix& jacobian : jacobians) write(jacobian);
  }
}
