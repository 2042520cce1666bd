// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The constants of a point-to-ruled-surface factor and their arithmetic, in GTSAM's types.
#pragma once

#include <gtsam/geometry/Pose3.h>
#include <gtsam/linear/NoiseModel.h>

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "ruledgraph/extrinsics.hpp"
#include "ruledgraph/frame_motions.hpp"
#include "ruledgraph/gtsam/compatibility.hpp"
#include "ruledgraph/gtsam/serialization.hpp"
#include "ruledgraph/observations.hpp"
#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

/// A line's edge points; their type chooses the residual: the geometric one, three rows a frame, or
/// the reprojection error, two rows a point.
using Points = std::variant<GeometricPoints, ReprojectionPoints>;

/// One line in all frames of an interval.
class RuledSurface {
 public:
  /// Of no frames.
  RuledSurface() = default;

  RuledSurface(const LineChart& chart, const FrameMotions& motions, Points points,
               const gtsam::Pose3& body_T_cam)
      : geometry_(chart, body_T_cam.rotation().matrix(), body_T_cam.translation(), motions.frames,
                  motions.bias, motions.timed),
        points_(std::move(points)) {}

  const Geometry& geometry() const { return geometry_; }
  const Points& points() const { return points_; }
  /// Of the residual: the dimension of the noise model.
  Eigen::Index rows() const {
    return std::visit([](const auto& points) { return points.rows(); }, points_);
  }

  /// The same observation of a line that has a new chart.
  RuledSurface with_chart(const LineChart& chart) const {
    RuledSurface other = *this;
    other.geometry_ = geometry_.with_chart(chart);
    return other;
  }

  /// Derivatives of the residual.
  struct Derivatives {
    gtsam::Matrix jacobian;        ///< the columns are those of `Geometry`
    gtsam::Matrix by_extrinsics;   ///< (rows x 6), where they are a variable
    gtsam::Vector by_focal_ratio;  ///< (rows)
  };

  /// Unwhitened residual and, unless null, its derivatives, by the camera's pose in the body only
  /// if there is one beside that of the geometry.
  gtsam::Vector evaluate(const State& state, const std::optional<gtsam::Pose3>& body_T_cam,
                         Derivatives* wanted) const {
    if (!body_T_cam) return evaluate_at(geometry_, state, wanted);
    const Geometry geometry = with_camera(*body_T_cam);
    const gtsam::Vector residual = evaluate_at(geometry, state, wanted);
    if (wanted != nullptr) {
      wanted->by_extrinsics = std::visit(
          [&](const auto& points) -> gtsam::Matrix {
            return by_extrinsics(geometry, points, state, wanted->jacobian.middleCols<6>(kPose));
          },
          points_);
    }
    return residual;
  }

  Geometry with_camera(const gtsam::Pose3& body_T_cam) const {
    return geometry_.with_camera(body_T_cam.rotation().matrix(), body_T_cam.translation());
  }

  bool equals(const RuledSurface& other, double tolerance) const {
    if (points_.index() != other.points_.index() || rows() != other.rows() ||
        !geometry_.equals(other.geometry_, tolerance)) {
      return false;
    }
    const auto close = [&](const auto& a, const auto& b) {
      return (a - b).cwiseAbs().maxCoeff() <= tolerance;
    };
    if (const auto* mine = std::get_if<GeometricPoints>(&points_)) {
      const auto& theirs = std::get<GeometricPoints>(other.points_).statistics;
      return std::equal(mine->statistics.begin(), mine->statistics.end(), theirs.begin(),
                        theirs.end(), close);
    }
    const auto& mine = std::get<ReprojectionPoints>(points_);
    const auto& theirs = std::get<ReprojectionPoints>(other.points_);
    return close(mine.points, theirs.points) && close(mine.sqrt_weights, theirs.sqrt_weights) &&
           mine.counts == theirs.counts;
  }

  /// Throws std::invalid_argument unless the noise model and the points fit.
  void check(const gtsam::SharedNoiseModel& noise_model) const {
    const auto frames = [](const auto& points) { return points.frames(); };
    if (std::visit(frames, points_) != geometry_.frames()) {
      throw std::invalid_argument("ruledgraph: the points are not from the frames of the motion");
    }
    if (!noise_model || static_cast<Eigen::Index>(noise_model->dim()) != rows()) {
      throw std::invalid_argument("ruledgraph: the noise model must have dimension " +
                                  std::to_string(rows()));
    }
  }

#ifdef RULEDGRAPH_SERIALIZATION
  template <class Archive>
  void serialize(Archive& archive, unsigned int) {
    archive& boost::serialization::make_nvp("geometry", geometry_);
    serialize_points(archive, points_);
  }
#endif

 private:
  gtsam::Vector evaluate_at(const Geometry& geometry, const State& state,
                            Derivatives* wanted) const {
    gtsam::Vector residual(rows());
    const auto write = [&](MatrixOut* jacobian, VectorOut* by_focal_ratio) {
      std::visit(
          [&](const auto& points) {
            ruledgraph::evaluate(geometry, points, state, residual, jacobian, by_focal_ratio);
          },
          points_);
    };
    if (wanted == nullptr) {
      write(nullptr, nullptr);
    } else {
      wanted->jacobian.resize(rows(), geometry.columns());
      wanted->by_focal_ratio.resize(rows());
      MatrixOut jacobian(wanted->jacobian);
      VectorOut by_focal_ratio(wanted->by_focal_ratio);
      write(&jacobian, &by_focal_ratio);
    }
    return residual;
  }

  Geometry geometry_;
  Points points_;
};

}  // namespace ruledgraph
