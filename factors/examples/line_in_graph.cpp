// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// One line in a GTSAM graph: a body moves sideways at 0.4 m/s and looks at an edge; the graph finds
// where the edge is. Prints the distances of its true ends from the estimated line, m, and fails
// if one is more than 1 cm.

#include <gtsam/inference/Symbol.h>
#include <gtsam/nonlinear/LevenbergMarquardtOptimizer.h>
#include <gtsam/nonlinear/Marginals.h>
#include <gtsam/nonlinear/NonlinearFactorGraph.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "ruledgraph/gtsam/line_factors.hpp"
#include "ruledgraph/gtsam/ruled_surface_factor.hpp"
#include "ruledgraph/gtsam/solvers.hpp"
#include "ruledgraph/new_line.hpp"
#include "ruledgraph/triangulation.hpp"

namespace rg = ruledgraph;
using gtsam::symbol_shorthand::B;
using gtsam::symbol_shorthand::E;
using gtsam::symbol_shorthand::F;
using gtsam::symbol_shorthand::L;
using gtsam::symbol_shorthand::T;
using gtsam::symbol_shorthand::V;
using gtsam::symbol_shorthand::X;

int main() {
  // Made-up measurements. World z is up; the camera looks along world y; body and camera are one.
  gtsam::Matrix3 world_R_body;
  world_R_body << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  const gtsam::Pose3 pose(gtsam::Rot3(world_R_body), gtsam::Point3(0, 0, 0)), body_T_cam;
  const gtsam::Vector3 velocity(0.4, 0.0, 0.0), zero(0.0, 0.0, 0.0);
  const double focal_length = 600.0;  // px
  const gtsam::Vector3 ends[2] = {{-0.3, 2.0, -0.4}, {0.4, 2.5, 0.5}};
  const Eigen::Index samples = 100;
  const Eigen::VectorXd imu_times = Eigen::VectorXd::LinSpaced(samples, 0.0, 0.495);
  const Eigen::Matrix3Xd gyroscope = Eigen::Matrix3Xd::Zero(3, samples);
  const Eigen::Matrix3Xd accelerometer = gtsam::Vector3(0.0, -9.81, 0.0).replicate(1, samples);
  std::vector<double> frame_times;
  std::vector<rg::PointRows> frames;  // of each frame the edge points, normalised and undistorted
  for (int i = 0; i < 9; ++i) {
    const double t = i / 30.0;
    rg::PointRows points(20, 2);
    for (int j = 0; j < 20; ++j) {
      const gtsam::Vector3 on_edge = ends[0] + j / 19.0 * (ends[1] - ends[0]);
      const gtsam::Vector3 in_cam = world_R_body.transpose() * (on_edge - t * velocity);
      points.row(j) << in_cam.x() / in_cam.z(), in_cam.y() / in_cam.z();
    }
    frame_times.push_back(t);
    frames.push_back(points);
  }

  // What you have already: a state, here held by priors.
  gtsam::NonlinearFactorGraph graph;
  gtsam::Values values;
  const gtsam::imuBias::ConstantBias bias;
  values.insert(X(0), pose);
  values.insert(V(0), velocity);
  values.insert(B(0), bias);
  graph.addPrior(X(0), pose, gtsam::noiseModel::Isotropic::Sigma(6, 1e-3));
  graph.addPrior(V(0), velocity, gtsam::noiseModel::Isotropic::Sigma(3, 1e-3));
  graph.addPrior(B(0), bias, gtsam::noiseModel::Isotropic::Sigma(6, 1e-3));

  // The motion from the state to each frame. The samples are not copied.
  const rg::ImuSamples imu{{imu_times.data(), samples},
                           {accelerometer.data(), 3, samples},
                           {gyroscope.data(), 3, samples}};
  const double state_time = 0.0;
  const rg::FrameMotions motions =
      rg::preintegrate_frames(imu, state_time, frame_times, bias.vector());

  // The line: its points, a chart from all views, a factor, a prior.
  const rg::GeometricPoints points = rg::compress_points(frames);
  const rg::State state = rg::state_of(pose, velocity, bias);
  std::vector<rg::Pose> cameras;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    cameras.push_back(rg::frame_pose(motions, i, state) * rg::from_gtsam(body_T_cam));
  }
  const double sigma = 0.5 / focal_length;  // half a pixel a point
  const rg::LineTriangulation found = rg::triangulate_line(cameras, points, sigma);
  if (!found.determined()) return 1;  // found.reason says why
  const rg::LineChart chart = found.chart;
  const auto noise = gtsam::noiseModel::Isotropic::Sigma(points.rows(), sigma);
  graph.add(
      rg::RuledSurfaceFactor(noise, X(0), V(0), B(0), L(0), motions, chart, points, body_T_cam));
  const gtsam::Vector4 reference(0.0, 0.0, 0.0, 0.0);
  values.insert(L(0), reference);
  const auto wide = gtsam::noiseModel::Diagonal::Sigmas(rg::new_line_sigmas());
  graph.add(rg::NewLineFactor(wide, X(0), L(0), chart, pose));

  // One frame that has a pose of its own needs no IMU.
  const auto one_frame = gtsam::noiseModel::Isotropic::Sigma(3, sigma);
  graph.add(rg::RuledSurfacePoseFactor(one_frame, X(0), L(0), chart,
                                       rg::compress_points({frames[0]}), body_T_cam));

  // A camera whose clock is not quite the IMU's: the offset of its frames, s, is a variable.
  const rg::FrameMotions timed =
      rg::preintegrate_frames(imu, state_time, frame_times, bias.vector(), true);
  rg::CameraKeys clock;
  clock.time = T(0);
  graph.add(rg::RuledSurfaceFactor(noise, X(0), V(0), B(0), L(0), timed, chart, points, clock,
                                   body_T_cam));
  values.insert(T(0), 0.0);
  graph.addPrior(T(0), 0.0, gtsam::noiseModel::Isotropic::Sigma(1, 1e-3));

  // The camera's pose in the body and the ratio of its focal length to the one that points were
  // normalised with as variables.
  rg::CameraKeys camera;
  camera.extrinsics = E(0);
  camera.focal = F(0);
  graph.add(rg::RuledSurfaceFactor(noise, X(0), V(0), B(0), L(0), motions, chart, points, camera));
  values.insert(E(0), body_T_cam);
  graph.addPrior(E(0), body_T_cam, gtsam::noiseModel::Isotropic::Sigma(6, 1e-2));
  values.insert(F(0), 1.0);
  graph.addPrior(F(0), 1.0, gtsam::noiseModel::Isotropic::Sigma(1, 5e-3));

  // A robust loss: two degrees of freedom a frame, whatever the number of points.
  const rg::GeometricPoints flat = rg::without_scatter(points);
  const auto cauchy = gtsam::noiseModel::mEstimator::Cauchy::Create(
      3.0 * std::sqrt(2.0 * static_cast<double>(flat.frames())));
  const auto robust = gtsam::noiseModel::Robust::Create(cauchy, noise);
  graph.add(
      rg::RuledSurfaceFactor(robust, X(0), V(0), B(0), L(0), motions, chart, flat, body_T_cam));

  gtsam::LevenbergMarquardtOptimizer optimizer(graph, values, rg::levenberg_marquardt_params());
  const gtsam::Values result = optimizer.optimize();

  // The line in the world.
  const gtsam::Vector4 line = result.at<gtsam::Vector4>(L(0));
  double furthest = 0.0;
  for (const gtsam::Vector3& end : ends) {
    const double distance = (rg::closest_point(chart, line, end).value - end).norm();
    std::printf("%.9f\n", distance);
    furthest = std::max(furthest, distance);
  }

  // The same line in a new chart, with its covariance, for a new key.
  const gtsam::Marginals marginals(graph, result);
  const gtsam::Matrix covariance = marginals.marginalCovariance(L(0));
  const rg::Reanchored moved = rg::reanchor(chart, line, cameras.back());
  const gtsam::Matrix moved_covariance = moved.by_line * covariance * moved.by_line.transpose();

  // Its factors on the new key, and which ones to remove: for a batch graph or ISAM2.
  const rg::MovedLine change = rg::move_line(graph, L(0), L(1), moved.chart);

  // Did every line end in its right minimum?
  bool all_well = true;
  for (const rg::LineCheck& check : rg::check_lines(graph, result)) all_well &= check.ok();
  return all_well && furthest < 0.01 && moved_covariance.allFinite() && change.indices.size() == 6
             ? 0
             : 1;
}
