// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Factors as the Python module `ruledgraph_factors._native` holds them, made of numpy arrays.
#pragma once

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "ruledgraph/extrinsics.hpp"
#include "ruledgraph/line_fit.hpp"
#include "ruledgraph/robust_lines.hpp"
#include "ruledgraph/ruled_surface.hpp"

namespace nb = nanobind;

namespace {

using namespace ruledgraph;
using Eigen::Index;
using Eigen::Matrix4d;

template <int Rows, int Columns>
using RowMajor = Eigen::Matrix<double, Rows, Columns, Eigen::RowMajor>;
template <int Rows, int Columns>
using RowMajorMap = Eigen::Map<const RowMajor<Rows, Columns>>;
template <typename Scalar, Eigen::Index... Shape>
using Rows = nb::ndarray<Scalar, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
using JacobianArray = nb::ndarray<double, nb::shape<-1, -1>, nb::f_contig, nb::device::cpu>;

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

LineChart make_chart(const Matrix4d& world_T_anchor, const Matrix3& basis, double angle) {
  return {world_T_anchor.topLeftCorner<3, 3>(), world_T_anchor.topRightCorner<3, 1>(), basis,
          angle};
}

Geometry make_geometry(const Matrix4d& world_T_anchor, const Matrix3& basis, double angle,
                       const Matrix4d& body_T_cam, Rows<const double, -1> elapsed,
                       Rows<const double, -1, 9> preintegrated,
                       Rows<const double, -1, 9, 6> bias_jacobian, const Vector6& bias,
                       Rows<const double, -1, 6> time_jacobian) {
  const std::size_t count = elapsed.shape(0);
  const bool timed = time_jacobian.is_valid();
  require(!timed || time_jacobian.shape(0) == count, "elapsed and time_jacobian differ in length");
  require(preintegrated.shape(0) == count && bias_jacobian.shape(0) == count,
          "elapsed, preintegrated and bias_jacobian differ in length");
  std::vector<FrameMotion> frames;
  for (std::size_t i = 0; i < count; ++i) {
    // The residuals do not depend on dv, the last three.
    frames.push_back({elapsed.data()[i], Eigen::Map<const Vector6>(preintegrated.data() + 9 * i),
                      RowMajorMap<6, 6>(bias_jacobian.data() + 54 * i)});
    if (timed) {
      frames.back().time_jacobian = Eigen::Map<const Vector6>(time_jacobian.data() + 6 * i);
    }
  }
  return Geometry(make_chart(world_T_anchor, basis, angle), body_T_cam.topLeftCorner<3, 3>(),
                  body_T_cam.topRightCorner<3, 1>(), std::move(frames), bias, timed);
}

/// All constants of one factor.
template <typename Points>
struct RuledSurface {
  Geometry geometry;
  Points points;

  void evaluate(const Matrix4d& world_T_body, const Vector3& velocity, const Vector6& bias,
                const Vector3& gravity, const Eigen::Vector4d& line, double time_shift,
                const std::optional<Matrix4d>& body_T_cam, std::optional<double> focal_ratio,
                VectorOut residual, JacobianArray jacobian) const {
    const State state{world_T_body.topLeftCorner<3, 3>(),
                      world_T_body.topRightCorner<3, 1>(),
                      velocity,
                      bias,
                      gravity,
                      line,
                      time_shift,
                      focal_ratio.value_or(1.0)};
    require(residual.size() == points.rows(), "residual has the wrong length");
    const bool with_focal = focal_ratio.has_value();
    if (!body_T_cam) {
      evaluate_at(geometry, state, false, with_focal, residual, jacobian);
      return;
    }
    evaluate_at(
        geometry.with_camera(body_T_cam->topLeftCorner<3, 3>(), body_T_cam->topRightCorner<3, 1>()),
        state, true, with_focal, residual, jacobian);
  }

  void evaluate_at(const Geometry& geometry, const State& state, bool with_extrinsics,
                   bool with_focal, VectorOut residual, JacobianArray jacobian) const {
    if (!jacobian.is_valid()) {
      ruledgraph::evaluate(geometry, points, state, residual, nullptr);
      return;
    }
    const Index own = geometry.columns(), at_end = own + (with_extrinsics ? 6 : 0);
    const Index columns = at_end + (with_focal ? 1 : 0);
    require(static_cast<Index>(jacobian.shape(0)) == points.rows() &&
                static_cast<Index>(jacobian.shape(1)) == columns,
            "jacobian has the wrong number of rows or columns");
    Eigen::Map<Eigen::MatrixXd> all(jacobian.data(), points.rows(), columns);
    MatrixOut out = all.leftCols(own);
    VectorOut by_focal_ratio = all.col(columns - 1);
    ruledgraph::evaluate(geometry, points, state, residual, &out,
                         with_focal ? &by_focal_ratio : nullptr);
    if (with_extrinsics) {
      all.middleCols<6>(own) = by_extrinsics(geometry, points, state, all.leftCols<6>());
    }
  }

  nb::tuple fit_line(const Matrix4d& world_T_body, const Vector3& velocity, const Vector6& bias,
                     const Vector3& gravity, const std::vector<Eigen::Vector4d>& starts,
                     double information, const Eigen::Vector4d& prior, std::size_t descents) const {
    require(!starts.empty(), "starts is empty");
    const State state{world_T_body.topLeftCorner<3, 3>(),
                      world_T_body.topRightCorner<3, 1>(),
                      velocity,
                      bias,
                      gravity,
                      starts.front()};
    LineProblem<Points> problem(geometry, points, state, information, prior);
    const LineMinimum fit = ruledgraph::fit_line(problem, starts, descents);
    return nb::make_tuple(fit.delta, fit.cost, fit.hessian);
  }
};

using GeometricSurface = RuledSurface<GeometricPoints>;
using ReprojectionSurface = RuledSurface<ReprojectionPoints>;

GeometricPoints geometric_points(Rows<const double, -1, 3, 3> statistics) {
  GeometricPoints points;
  for (std::size_t i = 0; i < statistics.shape(0); ++i) {
    points.statistics.push_back(RowMajorMap<3, 3>(statistics.data() + 9 * i));
  }
  return points;
}

GeometricSurface* make_geometric(const Geometry& geometry,
                                 Rows<const double, -1, 3, 3> statistics) {
  require(statistics.shape(0) == geometry.frames(), "statistics: not one for each frame");
  return new GeometricSurface{geometry, geometric_points(statistics)};
}

ReprojectionSurface* make_reprojection(const Geometry& geometry, Rows<const double, -1, 2> points,
                                       const Eigen::VectorXd& sqrt_weights,
                                       Rows<const std::int64_t, -1> frame) {
  const std::size_t count = points.shape(0);
  require(static_cast<std::size_t>(sqrt_weights.size()) == count && frame.shape(0) == count,
          "points, sqrt_weights and frame differ in length");
  ReprojectionPoints individual{
      RowMajorMap<Eigen::Dynamic, 2>(points.data(), static_cast<Index>(count), 2).transpose(),
      sqrt_weights, std::vector<Index>(geometry.frames(), 0)};
  std::int64_t previous = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::int64_t index = frame.data()[i];
    require(previous <= index && index < static_cast<std::int64_t>(geometry.frames()),
            "frame: not the frames of the points, in order");
    ++individual.counts[static_cast<std::size_t>(index)];
    previous = index;
  }
  return new ReprojectionSurface{geometry, std::move(individual)};
}

void robust_lines(const std::vector<const GeometricSurface*>& surfaces, double precision,
                  std::int64_t chunk, Rows<const double, -1> scales, const Matrix4d& world_T_body,
                  const Vector3& velocity, const Vector6& bias, const Vector3& gravity,
                  double time_shift, Rows<const double, -1, 4> lines, Rows<double, -1> losses,
                  Rows<double, -1, -1, -1> information, Rows<double, -1, -1> gradient) {
  const std::size_t count = surfaces.size();
  const bool want_equations = information.is_valid() && gradient.is_valid();
  require(chunk > 0, "chunk must be positive");
  require(lines.shape(0) == count && losses.shape(0) == count,
          "surfaces, lines and losses differ in length");
  State state{world_T_body.topLeftCorner<3, 3>(),
              world_T_body.topRightCorner<3, 1>(),
              velocity,
              bias,
              gravity,
              Vector4::Zero(),
              time_shift};
  Index first = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto& [geometry, points] = *surfaces[i];
    const Index chunks = (points.rows() + 3 * chunk - 1) / (3 * chunk);
    require(first + chunks <= static_cast<Index>(scales.shape(0)), "scales: not one for a chunk");
    const Eigen::Map<const Eigen::VectorXd> own(scales.data() + first, chunks);
    first += chunks;
    state.line = Eigen::Map<const Vector4>(lines.data() + 4 * i);
    const RobustLine line =
        robust_line(geometry, points, state, precision, chunk, own, want_equations);
    losses.data()[i] = line.loss;
    if (!want_equations) continue;
    const Index size = line.gradient.size();
    const auto fits = static_cast<std::size_t>(size);
    require(information.shape(0) == count && information.shape(1) == fits &&
                information.shape(2) == fits && gradient.shape(0) == count &&
                gradient.shape(1) == fits,
            "information or gradient has the wrong shape");
    const auto at = static_cast<Index>(i);
    Eigen::Map<Eigen::MatrixXd>(information.data() + at * size * size, size, size) =
        line.information;
    Eigen::Map<Eigen::VectorXd>(gradient.data() + at * size, size) = line.gradient;
  }
}

}  // namespace
