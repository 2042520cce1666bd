// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The point-to-ruled-surface residuals and their Jacobians; needs Eigen alone. `evaluate` is the
// entry: a `Geometry` and the points of as many frames are a factor's constants, a `State` its
// variables.
//
// The native version of `ruledgraph_factors/ruled_surface.py`, which says what is computed and
// stays the reference: same equations, same names, same behaviour at degenerate geometry. The
// columns of a Jacobian are GTSAM's tangents of pose (rotation first, right perturbation),
// velocity, bias (accelerometer, gyroscope), gravity and line, and of a timed geometry one more:
// how much later the frames were taken.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "ruledgraph/line_chart.hpp"
#include "ruledgraph/so3.hpp"
#include "ruledgraph/state.hpp"

namespace ruledgraph {

constexpr int kColumns = 22;
constexpr int kPose = 0, kVelocity = 6, kBias = 9, kGravity = 15, kLine = 18, kTime = 22;

constexpr double kNoRuling = 1e-9;
constexpr double kBehindCameraResidual = 2.0;
constexpr double kNegligibleDepth = 1e-9;
constexpr double kEndOn = 1e-18;

/// The line in one camera, up to the common scale of its unit Pluecker pair.
struct CameraLine {
  Vector3 moment;
  Vector3 direction;                                         ///< unit
  Eigen::Matrix<double, 3, kColumns> d_moment, d_direction;  ///< only when asked for
  Vector3 moment_by_time, direction_by_time;                 ///< and of a timed geometry
};

/// The constants that bring a line into the cameras of an interval.
class Geometry {
 public:
  /// Of no frames.
  Geometry() = default;

  /// `bias` is the one that all of `frames` were integrated with; `timed` says whether their time
  /// is a variable.
  Geometry(LineChart chart, const Matrix3& body_R_cam, const Vector3& body_t_cam,
           std::vector<FrameMotion> frames, const Vector6& bias, bool timed = false)
      : chart_(std::move(chart)),
        cam_R_body_(body_R_cam.transpose()),
        body_t_cam_(body_t_cam),
        frames_(std::move(frames)),
        bias_(bias),
        timed_(timed) {}

  std::size_t frames() const { return frames_.size(); }
  const LineChart& chart() const { return chart_; }
  const FrameMotion& motion(std::size_t frame) const { return frames_[frame]; }
  const std::vector<FrameMotion>& motions() const { return frames_; }
  const Vector6& bias() const { return bias_; }
  Matrix3 body_R_cam() const { return cam_R_body_.transpose(); }
  const Vector3& body_t_cam() const { return body_t_cam_; }

  /// (theta, dp) of a frame at a state, see `ruledgraph::corrected`.
  Vector6 corrected(std::size_t frame, const State& state) const {
    return ruledgraph::corrected(frames_[frame], state, bias_, timed_);
  }

  /// The same with another camera.
  Geometry with_camera(const Matrix3& body_R_cam, const Vector3& body_t_cam) const {
    return {chart_, body_R_cam, body_t_cam, frames_, bias_, timed_};
  }

  /// The same with the line in another chart.
  Geometry with_chart(const LineChart& chart) const {
    Geometry other = *this;
    other.chart_ = chart;
    return other;
  }

  /// Whether all constants are those of another, to a tolerance.
  bool equals(const Geometry& other, double tolerance) const {
    const auto close = [&](const auto& a, const auto& b) {
      return (a - b).cwiseAbs().maxCoeff() <= tolerance;
    };
    const auto same_frame = [&](const FrameMotion& a, const FrameMotion& b) {
      return std::abs(a.elapsed - b.elapsed) <= tolerance &&
             close(a.preintegrated, b.preintegrated) && close(a.bias_jacobian, b.bias_jacobian) &&
             close(a.time_jacobian, b.time_jacobian);
    };
    return timed_ == other.timed_ && close(chart_.world_R_anchor, other.chart_.world_R_anchor) &&
           close(chart_.world_t_anchor, other.chart_.world_t_anchor) &&
           close(chart_.basis, other.chart_.basis) &&
           std::abs(chart_.angle - other.chart_.angle) <= tolerance &&
           close(cam_R_body_, other.cam_R_body_) && close(body_t_cam_, other.body_t_cam_) &&
           close(bias_, other.bias_) &&
           std::equal(frames_.begin(), frames_.end(), other.frames_.begin(), other.frames_.end(),
                      same_frame);
  }

  bool timed() const { return timed_; }
  Eigen::Index columns() const { return kColumns + (timed_ ? 1 : 0); }

  WorldLine line_in_world(const State& state) const {
    return ruledgraph::line_in_world(chart_, state.line);
  }

  CameraLine line_in_camera(std::size_t frame, const State& state, const WorldLine& line,
                            bool want_jacobian) const {
    const FrameMotion& motion = frames_[frame];
    const double t = motion.elapsed;
    const Vector6 delta = corrected(frame, state);
    double by_velocity = t, by_gravity = 0.5 * t * t;
    if (timed_) {
      by_velocity += state.time_shift;
      by_gravity += t * state.time_shift;
    }
    const Vector3 delta_position = delta.tail<3>();
    const Exponential turn = exponential(delta.head<3>());
    const Matrix3 rotation = state.rotation * turn.rotation;
    const Vector3 position = state.position + state.velocity * by_velocity +
                             state.gravity * by_gravity + state.rotation * delta_position;

    const Matrix3 body_R_world = rotation.transpose();
    const Matrix3 cam_R_world = cam_R_body_ * body_R_world;
    const Vector3 lever = chart_.world_t_anchor - (position + rotation * body_t_cam_);
    const Vector3 turned = lever.cross(line.along);
    const Vector3 world_moment = line.cosine * line.normal + line.sine * turned;
    CameraLine result;
    result.moment = cam_R_world * world_moment;
    result.direction = cam_R_world * line.along;
    if (!want_jacobian) return result;

    // By the frame's own pose: right perturbation (rotation, translation) of the body.
    const Matrix3 across = hat(body_R_world * line.along);
    const Matrix3 by_translation = line.sine * (cam_R_body_ * across);
    const Matrix3 by_rotation =
        cam_R_body_ * hat(body_R_world * world_moment) - by_translation * hat(body_t_cam_);
    const Matrix3 direction_by_rotation = cam_R_body_ * across;

    // By the state through the frame's pose.
    const Matrix3 frame_R_state = turn.rotation.transpose();
    const Eigen::Matrix<double, 3, 6> turn_by_bias =
        turn.right_jacobian * motion.bias_jacobian.topRows<3>();
    const Matrix3 by_state_translation = by_translation * frame_R_state;
    const Matrix3 by_world_translation = by_translation * body_R_world;
    auto& d_moment = result.d_moment;
    d_moment.middleCols<3>(kPose) =
        by_rotation * frame_R_state - by_state_translation * hat(delta_position);
    d_moment.middleCols<3>(kPose + 3) = by_state_translation;
    d_moment.middleCols<3>(kVelocity) = by_world_translation * by_velocity;
    d_moment.middleCols<6>(kBias) =
        by_rotation * turn_by_bias + by_state_translation * motion.bias_jacobian.bottomRows<3>();
    d_moment.middleCols<3>(kGravity) = by_world_translation * by_gravity;
    d_moment.middleCols<3>(kLine + 1) =
        cam_R_world * (line.cosine * line.d_normal + line.sine * (hat(lever) * line.d_along));
    d_moment.col(kLine) = cam_R_world * (line.cosine * turned - line.sine * line.normal);

    auto& d_direction = result.d_direction;
    d_direction.setZero();
    d_direction.middleCols<3>(kPose) = direction_by_rotation * frame_R_state;
    d_direction.middleCols<6>(kBias) = direction_by_rotation * turn_by_bias;
    d_direction.middleCols<3>(kLine + 1) = cam_R_world * line.d_along;
    if (timed_) {
      const Vector3 turning = turn.right_jacobian * motion.time_jacobian.head<3>();
      result.moment_by_time = by_rotation * turning +
                              by_state_translation * motion.time_jacobian.tail<3>() +
                              by_world_translation * (state.velocity + state.gravity * t);
      result.direction_by_time = direction_by_rotation * turning;
    }
    return result;
  }

 private:
  LineChart chart_{};
  Matrix3 cam_R_body_ = Matrix3::Identity();
  Vector3 body_t_cam_ = Vector3::Zero();
  std::vector<FrameMotion> frames_;
  Vector6 bias_ = Vector6::Zero();
  bool timed_ = false;
};

/// The points of each frame as triangular statistics C: three rows a frame, C m / |m_xy|.
struct GeometricPoints {
  std::vector<Matrix3> statistics;

  std::size_t frames() const { return statistics.size(); }
  Eigen::Index rows() const { return 3 * static_cast<Eigen::Index>(statistics.size()); }
  /// Of one frame.
  Eigen::Index rows_of(std::size_t) const { return 3; }
};

/// The points of all frames one by one: two rows a point, the paper's reprojection error.
struct ReprojectionPoints {
  Eigen::Matrix2Xd points;           ///< frame after frame
  Eigen::VectorXd sqrt_weights;      ///< one a point
  std::vector<Eigen::Index> counts;  ///< of the points in each frame

  std::size_t frames() const { return counts.size(); }
  Eigen::Index rows() const { return 2 * points.cols(); }
  /// Of one frame.
  Eigen::Index rows_of(std::size_t frame) const { return 2 * counts[frame]; }
};

using VectorOut = Eigen::Ref<Eigen::VectorXd>;
using MatrixOut = Eigen::Ref<Eigen::MatrixXd>;

/// Unwhitened geometric residual (rows) and, unless null, its Jacobian (rows x columns()) and its
/// derivative by the focal ratio. A frame without a finite ruling has zero rows.
inline void evaluate(const Geometry& geometry, const GeometricPoints& points, const State& state,
                     VectorOut residual, MatrixOut* jacobian, VectorOut* by_focal_ratio = nullptr) {
  const WorldLine world = geometry.line_in_world(state);
  for (std::size_t i = 0; i < geometry.frames(); ++i) {
    const CameraLine line = geometry.line_in_camera(i, state, world, jacobian != nullptr);
    const Eigen::Index row = 3 * static_cast<Eigen::Index>(i);
    const double size = std::hypot(line.moment.x(), line.moment.y());
    // As a factor: NaN stays NaN.
    const double inverse = size > kNoRuling ? 1.0 / size : 0.0;
    const Vector3 unit = line.moment * inverse;
    if (by_focal_ratio != nullptr) {
      by_focal_ratio->segment<3>(row) = points.statistics[i].col(2) * unit.z();
    }
    Matrix3 statistic = points.statistics[i];
    statistic.col(2) *= state.focal_ratio;
    residual.segment<3>(row) = statistic * unit;
    if (jacobian == nullptr) continue;
    // d (m / |m_xy|) = (I - unit (unit_x, unit_y, 0)) dm / |m_xy|
    Matrix3 projector = Matrix3::Identity();
    projector.leftCols<2>() -= unit * unit.head<2>().transpose();
    const Matrix3 by_moment = (statistic * projector) * inverse;
    jacobian->block<3, kColumns>(row, 0).noalias() = by_moment * line.d_moment;
    if (geometry.timed()) jacobian->block<3, 1>(row, kTime) = by_moment * line.moment_by_time;
  }
}

/// One point's residual and its derivative by S = d x m and d, (2, 6).
struct PointResidual {
  Eigen::Vector2d value;
  Eigen::Matrix<double, 2, 6> by_line;
};

/// The paper's residual of a point p with alpha in closed form; `side` is the sign of sin(phi).
/// (2, 2) without slope behind the camera, zero without slope for a ruling seen end-on in p.
inline PointResidual reprojection(const Eigen::Vector2d& p, const Vector3& closest,
                                  const Vector3& direction, double side) {
  const Eigen::Vector2d p_vector = p * direction.z() - direction.head<2>();
  const Eigen::Vector2d phi = closest.head<2>() - p * closest.z();
  const double pp = p_vector.squaredNorm();
  PointResidual result{Eigen::Vector2d::Zero(), Eigen::Matrix<double, 2, 6>::Zero()};
  if (pp <= kEndOn) return result;
  const double alpha = p_vector.dot(phi) / pp;
  const Vector3 foot = closest + alpha * direction;
  if (foot.z() * side <= kNegligibleDepth) {
    result.value.setConstant(kBehindCameraResidual);
    return result;
  }
  const double inverse = 1.0 / foot.z();
  const Eigen::Vector2d projected = foot.head<2>() * inverse;
  result.value = p - projected;

  // d alpha = (Phi . dP + P . dPhi - 2 alpha P . dP) / P . P
  const Eigen::Vector2d bracket = phi - 2.0 * alpha * p_vector;
  const Eigen::RowVector3d alpha_by_closest(p_vector.x() / pp, p_vector.y() / pp,
                                            -p_vector.dot(p) / pp);
  const Eigen::RowVector3d alpha_by_direction(-bracket.x() / pp, -bracket.y() / pp,
                                              bracket.dot(p) / pp);
  Eigen::Matrix<double, 2, 3> by_foot;
  by_foot << -inverse, 0.0, projected.x() * inverse, 0.0, -inverse, projected.y() * inverse;
  const Eigen::Vector2d by_alpha = by_foot * direction;
  result.by_line.leftCols<3>() = by_foot + by_alpha * alpha_by_closest;
  result.by_line.rightCols<3>() = alpha * by_foot + by_alpha * alpha_by_direction;
  return result;
}

/// Unwhitened reprojection residual (rows) and, unless null, its Jacobian (rows x columns()) and
/// its derivative by the focal ratio.
inline void evaluate(const Geometry& geometry, const ReprojectionPoints& points, const State& state,
                     VectorOut residual, MatrixOut* jacobian, VectorOut* by_focal_ratio = nullptr) {
  const WorldLine world = geometry.line_in_world(state);
  const Vector3 stretch(state.focal_ratio, state.focal_ratio, 1.0);
  const double side = world.sine >= 0.0 ? 1.0 : -1.0;
  Eigen::Index point = 0;
  Eigen::Matrix<double, Eigen::Dynamic, 6> by_line;
  for (std::size_t i = 0; i < geometry.frames(); ++i) {
    const CameraLine line = geometry.line_in_camera(i, state, world, jacobian != nullptr);
    // The line's point next to the camera's centre, times sin(phi).
    const Vector3 in_camera = line.direction.cross(line.moment);
    const Vector3 closest = stretch.cwiseProduct(in_camera);
    const Vector3 direction = stretch.cwiseProduct(line.direction);
    const Eigen::Index first_row = 2 * point, count = points.counts[i];
    by_line.resize(2 * count, 6);
    for (Eigen::Index j = 0; j < count; ++j, ++point) {
      const PointResidual one = reprojection(points.points.col(point), closest, direction, side);
      const double weight = points.sqrt_weights[point];
      residual.segment<2>(2 * point) = weight * one.value;
      by_line.middleRows<2>(2 * j) = weight * one.by_line;
    }
    if (by_focal_ratio != nullptr) {
      Vector6 stretched;
      stretched << in_camera.head<2>(), 0.0, line.direction.head<2>(), 0.0;
      by_focal_ratio->segment(first_row, 2 * count) = by_line * stretched;
    }
    if (jacobian == nullptr) continue;
    // From here on by the line without the stretch.
    by_line.leftCols<3>() *= stretch.asDiagonal();
    by_line.rightCols<3>() *= stretch.asDiagonal();
    Eigen::Matrix<double, 6, kColumns> d_line;
    d_line.topRows<3>() = hat(line.direction) * line.d_moment - hat(line.moment) * line.d_direction;
    d_line.bottomRows<3>() = line.d_direction;
    auto rows = jacobian->middleRows(first_row, 2 * count);
    rows.leftCols<kColumns>().noalias() = by_line.lazyProduct(d_line);
    if (!geometry.timed()) continue;
    Vector6 line_by_time;
    line_by_time << line.direction.cross(line.moment_by_time) -
                        line.moment.cross(line.direction_by_time),
        line.direction_by_time;
    rows.col(kTime) = by_line * line_by_time;
  }
}

}  // namespace ruledgraph
