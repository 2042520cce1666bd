// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The GTSAM factors in C++, against a real GTSAM or the stand-in beside this file. Reads factors
// and the point to evaluate them at from standard input (`test_cpp_factors.py` writes them), checks
// Jacobians numerically, clone, equals, print and archives, and writes residuals and Jacobians.

#undef NDEBUG
#include <cassert>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <sstream>

#include "ruledgraph/gtsam/line_factors.hpp"
#include "ruledgraph/gtsam/ruled_surface_factor.hpp"
#include "ruledgraph/gtsam/solvers.hpp"
#include "ruledgraph/new_line.hpp"
#include "serialized.hpp"
#include "stream.hpp"
#include "throws.hpp"

namespace {

using namespace ruledgraph;
using gtsam::Key;
using gtsam::Matrix;
using gtsam::Values;
using gtsam::Vector;

constexpr Key kPoseKey = 0, kVelocityKey = 1, kBiasKey = 2, kGravityKey = 3, kLineKey = 4;
constexpr Key kNewLineKey = 5, kTimeKey = 6, kExtrinsicsKey = 7, kFocalKey = 8;

/// As `LineObservation::Form`, and the factors on a line alone.
enum Kind {
  kNode,
  kGravityDirection,
  kGravityVector,
  kPoseOnly,
  kNewLine,
  kLineDistance,
  kSameLine,
};

gtsam::Pose3 read_pose() {
  const Pose pose = read_plain_pose();
  return to_gtsam(pose);
}

struct Case {
  Kind kind;
  gtsam::NonlinearFactor::shared_ptr factor;
  Values values;
};

gtsam::NonlinearFactor::shared_ptr make_factor(Kind kind, const CameraKeys& camera,
                                               const FrameMotions& motions, const LineChart& chart,
                                               const Points& points, const gtsam::Pose3& body_T_cam,
                                               const Vector3& gravity) {
  const Eigen::Index rows = std::visit([](const auto& p) { return p.rows(); }, points);
  const auto noise = gtsam::noiseModel::Unit::Create(static_cast<std::size_t>(rows));
  const Key x = kPoseKey, v = kVelocityKey, b = kBiasKey, g = kGravityKey, l = kLineKey;
  using Factor = RuledSurfaceFactor;
  using PoseFactor = RuledSurfacePoseFactor;
  switch (kind) {
    case kNode:
      return Factor(noise, x, v, b, l, motions, chart, points, camera, body_T_cam, gravity).clone();
    case kGravityDirection:
      return Factor::WithGravityDirection(noise, x, v, b, g, l, motions, chart, points, body_T_cam,
                                          gravity.norm())
          .clone();
    case kGravityVector:
      return Factor::WithGravityVector(noise, x, v, b, g, l, motions, chart, points, body_T_cam)
          .clone();
    case kPoseOnly:
      return PoseFactor(noise, x, l, chart, points, camera, body_T_cam).clone();
    default:
      throw std::logic_error("no such kind");
  }
}

Case read_observation(Kind kind) {
  CameraKeys camera;
  if (read_number() != 0.0) camera.time = kTimeKey;
  if (read_number() != 0.0) camera.extrinsics = kExtrinsicsKey;
  if (read_number() != 0.0) camera.focal = kFocalKey;
  const LineChart chart = read_chart();
  const gtsam::Pose3 body_T_cam = read_pose();
  const FrameMotions motions = read_motions();
  const bool compressed = read_number() != 0.0;
  const std::vector<PointRows> frames = read_frames();
  const Points points = compressed ? Points(compress_points(frames)) : individual_points(frames);
  const Vector3 gravity = read_fixed<3>();

  Case found{kind, make_factor(kind, camera, motions, chart, points, body_T_cam, gravity),
             Values()};
  found.values.insert(kPoseKey, read_pose());
  found.values.insert(kVelocityKey, gtsam::Vector3(read_fixed<3>()));
  found.values.insert(kBiasKey, gtsam::imuBias::ConstantBias(read_fixed<6>()));
  found.values.insert(kLineKey, gtsam::Vector4(read_fixed<4>()));
  if (camera.time) found.values.insert(kTimeKey, read_number());
  if (camera.extrinsics) found.values.insert(kExtrinsicsKey, read_pose());
  if (camera.focal) found.values.insert(kFocalKey, read_number());
  if (kind == kGravityDirection) found.values.insert(kGravityKey, gtsam::Unit3(read_fixed<3>()));
  if (kind == kGravityVector) found.values.insert(kGravityKey, gtsam::Vector3(read_fixed<3>()));
  return found;
}

Case read_case(Kind kind) {
  if (kind < kNewLine) return read_observation(kind);
  const LineChart chart = read_chart();
  Case found{kind, {}, Values()};
  if (kind == kSameLine) {
    const Vector4 delta = read_fixed<4>();
    const LineChart new_chart = read_chart();
    const auto noise = gtsam::noiseModel::Unit::Create(4);
    found.factor = SameLineFactor(noise, kLineKey, kNewLineKey, chart, delta, new_chart).clone();
    found.values.insert(kLineKey, gtsam::Vector4(read_fixed<4>()));
    found.values.insert(kNewLineKey, gtsam::Vector4(read_fixed<4>()));
    return found;
  }
  if (kind == kNewLine) {
    const auto noise = gtsam::noiseModel::Unit::Create(4);
    found.factor = NewLineFactor(noise, kPoseKey, kLineKey, chart, read_pose()).clone();
  } else {
    const auto noise = gtsam::noiseModel::Unit::Create(1);
    found.factor = LineDistanceFactor(noise, kPoseKey, kLineKey, chart, read_number()).clone();
  }
  found.values.insert(kPoseKey, read_pose());
  found.values.insert(kLineKey, gtsam::Vector4(read_fixed<4>()));
  return found;
}

/// The values with one of them moved along its tangent.
Values moved(const Case& at, Key key, const Vector& tangent) {
  Values values = at.values;
  if (key == kPoseKey || key == kExtrinsicsKey) {
    values.update(key, gtsam::Pose3(values.at<gtsam::Pose3>(key).retract(tangent)));
  } else if (key == kBiasKey) {
    const gtsam::Vector6 bias = values.at<gtsam::imuBias::ConstantBias>(key).vector() + tangent;
    values.update(key, gtsam::imuBias::ConstantBias(bias));
  } else if (key == kLineKey || key == kNewLineKey) {
    values.update(key, gtsam::Vector4(values.at<gtsam::Vector4>(key) + tangent));
  } else if (key == kTimeKey || key == kFocalKey) {
    values.update(key, values.at<double>(key) + tangent[0]);
  } else if (key == kGravityKey && at.kind == kGravityDirection) {
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
  if (at.kind == kNewLine) return;  // by the pose it is not the derivative, on purpose
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
  CameraKeys camera;
  camera.time = 4;
  assert(throws([&] { RuledSurfaceFactor(noise(3), 0, 1, 2, 3, rest, chart, one, camera); }));
  assert(throws([&] { RuledSurfacePoseFactor(noise(3), 0, 1, chart, one, camera); }));
}

void line_factors_check_their_arguments() {
  const Pose origin;
  const LineChart chart = chart_from_points(origin, {0.0, 0.0, 3.0}, {1.0, 0.0, 3.0});
  const LineChart other = chart_from_points(origin, {0.0, 1.0, 3.0}, {1.0, 0.0, 3.0});
  const LineChart through = chart_from_points(origin, {0.0, 0.0, 0.0}, {1.0, 0.0, 0.0});
  const auto noise = [](std::size_t dim) { return gtsam::noiseModel::Unit::Create(dim); };
  const gtsam::Pose3 pose;
  assert(!throws([&] { NewLineFactor(noise(4), 0, 1, chart, pose); }));
  assert(throws([&] { NewLineFactor(noise(3), 0, 1, chart, pose); }));
  assert(throws([&] { NewLineFactor(noise(4), 0, 1, through, pose); }));
  assert(!throws([&] { LineDistanceFactor(noise(1), 0, 1, chart, 3.0); }));
  assert(throws([&] { LineDistanceFactor(noise(4), 0, 1, chart, 3.0); }));
  assert(throws([&] { LineDistanceFactor(noise(1), 0, 1, chart, 0.0); }));
  assert(!throws([&] { SameLineFactor(noise(4), 0, 1, chart, Vector4::Zero(), chart); }));
  assert(throws([&] { SameLineFactor(noise(1), 0, 1, chart, Vector4::Zero(), chart); }));
  assert(throws([&] { SameLineFactor(noise(4), 0, 1, chart, Vector4::Zero(), other); }));
}

/// One point on the image of a line three metres in front, one off it by `offset`.
RuledSurfacePoseFactor one_view(const LineChart& chart, double offset, bool robust) {
  PointRows points(2, 2);
  points << 0.0, 0.0, 0.1, offset;
  gtsam::SharedNoiseModel noise = gtsam::noiseModel::Isotropic::Sigma(3, 0.01);
  if (robust) {
    const auto huber = gtsam::noiseModel::mEstimator::Huber::Create(1.0);
    noise = gtsam::noiseModel::Robust::Create(huber, noise);
  }
  return RuledSurfacePoseFactor(noise, kPoseKey, kLineKey, chart, compress_points({points}));
}

void lines_are_checked_and_moved() {
  const LineChart chart = chart_from_points({}, {0.0, 0.0, 3.0}, {1.0, 0.0, 3.0});
  Values values;
  values.insert(kPoseKey, gtsam::Pose3());
  values.insert(kLineKey, gtsam::Vector4(gtsam::Vector4::Zero()));
  for (const bool robust : {false, true}) {
    gtsam::NonlinearFactorGraph graph;
    graph.add(one_view(chart, 0.02, robust));
    graph.add(NewLineFactor(gtsam::noiseModel::Unit::Create(4), kPoseKey, kLineKey, chart, {}));
    const std::vector<LineCheck> checks = check_lines(graph, values);
    assert(checks.size() == 1 && checks[0].key == kLineKey && checks[0].ok());
    assert(std::abs(checks[0].chi_squared - 4.0) < 1e-9);  // 0.02 / 0.01, without a robust loss
    assert(std::abs(checks[0].expected - 2.0) < 1e-9);
    graph.add(one_view(chart, 0.2, robust));
    assert(check_lines(graph, values)[0].misfit());
  }
  // Without scatter two are expected of a frame, whatever the number of its points.
  PointRows many(12, 2);
  for (int i = 0; i < 12; ++i) many.row(i) << 0.1 * i, i % 2 == 0 ? 0.01 : -0.01;
  const GeometricPoints points = compress_points({many});
  for (const auto& [kind, expected] : {std::pair{points, 12.0}, {without_scatter(points), 2.0}}) {
    gtsam::NonlinearFactorGraph graph;
    const auto noise = gtsam::noiseModel::Isotropic::Sigma(3, 0.01);
    graph.add(RuledSurfacePoseFactor(noise, kPoseKey, kLineKey, chart, kind));
    assert(std::abs(check_lines(graph, values)[0].expected - expected) < 1e-9);
  }
  Values far = values;
  far.update(kLineKey, gtsam::Vector4(0.0, 0.0, 0.0, 3.2));
  gtsam::NonlinearFactorGraph graph;
  graph.add(one_view(chart, 0.0, false));
  assert(check_lines(graph, far)[0].far);
  // Beyond infinity, and so behind the camera.
  far.update(kLineKey, gtsam::Vector4(-2.0 * chart.angle, 0.0, 0.0, 0.0));
  assert(check_lines(graph, far)[0].behind == 1.0);

  const Reanchored found = recentred(chart, Vector4(0.1, 0.1, -0.1, 0.2));
  const MovedLine moved = move_line(graph, kLineKey, kNewLineKey, found.chart);
  assert(moved.indices.size() == 1 && moved.indices[0] == 0 && moved.factors.size() == 1);
  values.insert(kNewLineKey, gtsam::Vector4(gtsam::Vector4::Zero()));
  values.update(kLineKey, gtsam::Vector4(0.1, 0.1, -0.1, 0.2));
  const auto error_of = [&](const gtsam::NonlinearFactor& factor) {
    return dynamic_cast<const gtsam::NoiseModelFactor&>(factor).unwhitenedError(values);
  };
  assert((error_of(*moved.factors[0]) - error_of(*graph[0])).norm() < 1e-12);
  assert(move_line(graph, kNewLineKey, kLineKey, chart).indices.empty());
}

void charts_are_compared() {
  const LineChart chart = chart_from_points({}, {0.0, 0.0, 3.0}, {1.0, 0.0, 3.0});
  const gtsam::Pose3 pose(gtsam::Rot3(), gtsam::Point3(0.0, 0.5, 0.0));
  const LineChart other = reanchor(chart, Vector4::Zero(), from_gtsam(pose)).chart;
  const auto noise = [](std::size_t dim) { return gtsam::noiseModel::Unit::Create(dim); };
  Values values;
  values.insert(kPoseKey, gtsam::Pose3());
  values.insert(kLineKey, gtsam::Vector4(gtsam::Vector4::Zero()));
  values.insert(kNewLineKey, gtsam::Vector4(gtsam::Vector4::Zero()));
  // Factors with the right chart, and with one of the same line from elsewhere.
  for (const bool wrong : {false, true}) {
    const LineChart& own = wrong ? other : chart;
    const SameLineFactor tie(noise(4), kLineKey, kNewLineKey, own, Vector4::Zero(), other);
    const SameLineFactor tie_to(noise(4), kNewLineKey, kLineKey, other, Vector4::Zero(), own);
    for (const gtsam::NonlinearFactor::shared_ptr& factor :
         {one_view(own, 0.02, false).clone(),
          NewLineFactor(noise(4), kPoseKey, kLineKey, own, pose).clone(),
          LineDistanceFactor(noise(1), kPoseKey, kLineKey, own, 3.0).clone(), tie.clone(),
          tie_to.clone()}) {
      gtsam::NonlinearFactorGraph graph;
      graph.add(one_view(chart, 0.02, false));
      graph.push_back(factor);
      const std::vector<LineCheck> checks = check_lines(graph, values);
      assert(checks.size() == 1 && checks[0].mixed_charts == wrong && checks[0].ok() != wrong);
    }
  }
  // A line that is not a number is named.
  gtsam::NonlinearFactorGraph graph;
  graph.add(one_view(chart, 0.02, false));
  values.update(kLineKey, gtsam::Vector4(0.0, 0.0, std::nan(""), 0.0));
  const LineCheck check = check_lines(graph, values)[0];
  assert(check.key == kLineKey && check.undefined() && !check.ok());
}

std::string name_of(const Case& at) {
  if (at.kind == kNewLine) return "one NewLineFactor";
  if (at.kind == kLineDistance) return "one LineDistanceFactor";
  if (at.kind == kSameLine) return "one SameLineFactor";
  const bool pose = at.kind == kPoseOnly;
  return pose ? "one RuledSurfacePoseFactor: " : "one RuledSurfaceFactor: ";
}

}  // namespace

int main() {
  sizes_are_checked();
  line_factors_check_their_arguments();
  lines_are_checked_and_moved();
  charts_are_compared();
  assert(isam2_params().relinearizeSkip == 1);
  levenberg_marquardt_params();
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
    assert(printed(*at.factor).rfind(name_of(at), 0) == 0);
    assert(survives_an_archive(*at.factor));
    write(residual);
    for (const Matrix& jacobian : jacobians) write(jacobian);
  }
  return 0;
}
