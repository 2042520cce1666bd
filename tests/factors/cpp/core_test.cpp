// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The C++ headers by themselves, with nothing but Eigen: derivatives against central differences,
// and the behaviour at degenerate geometry. With an argument it computes what Python does, too,
// from standard input to standard output. `test_cpp_headers.py` compiles and runs it.

#undef NDEBUG
#include <cassert>
#include <cstdio>
#include <functional>
#include <limits>

#include "motions.hpp"
#include "ruledgraph/frame_motions.hpp"
#include "ruledgraph/new_line.hpp"
#include "ruledgraph/observations.hpp"
#include "ruledgraph/ruled_surface.hpp"
#include "ruledgraph/triangulation.hpp"
#include "stream.hpp"
#include "throws.hpp"

namespace {

using namespace ruledgraph;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kFrameCount = 4;

Matrix3 random_rotation() { return exponential(Vector3::Random()).rotation; }

State random_state() {
  return {random_rotation(),           Vector3::Random(),       Vector3::Random(),
          0.1 * Vector6::Random(),     9.0 * Vector3::Random(), 0.02 * Eigen::Vector4d::Random(),
          0.01 * Vector3::Random().x()};
}

/// GTSAM's retraction: right perturbation of the pose, rotation first; all else is added.
State retract(State state, const VectorXd& tangent) {
  state.position += state.rotation * tangent.segment<3>(kPose + 3);
  state.rotation *= exponential(tangent.segment<3>(kPose)).rotation;
  state.velocity += tangent.segment<3>(kVelocity);
  state.bias += tangent.segment<6>(kBias);
  state.gravity += tangent.segment<3>(kGravity);
  state.line += tangent.segment<4>(kLine);
  if (tangent.size() > kTime) state.time_shift += tangent[kTime];
  return state;
}

/// A line about three metres in front of the camera of `state`.
Geometry random_geometry(const State& state, bool timed) {
  const Matrix3 body_R_cam = random_rotation();
  const Vector3 body_t_cam = 0.1 * Vector3::Random();
  std::vector<FrameMotion> frames;
  for (int i = 0; i < kFrameCount; ++i) {
    frames.push_back(
        {0.02 * i, 0.02 * Vector6::Random(), 0.05 * Matrix6::Random(), Vector6::Random()});
  }
  // Columns: normal of the viewing plane, the line's direction, and from its foot to the camera.
  Matrix3 basis;
  basis << 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0;
  const LineChart chart{state.rotation * body_R_cam, state.position + state.rotation * body_t_cam,
                        basis * exponential(0.1 * Vector3::Random()).rotation,
                        std::atan(1.0 / 3.0)};
  return Geometry(chart, body_R_cam, body_t_cam, frames, 0.05 * Vector6::Random(), timed);
}

template <typename Points>
VectorXd residual_at(const Geometry& geometry, const Points& points, const State& state) {
  VectorXd residual(points.rows());
  evaluate(geometry, points, state, residual, nullptr);
  return residual;
}

template <typename Points>
void check_jacobian(const Geometry& geometry, const Points& points, const State& state) {
  VectorXd residual(points.rows());
  const Eigen::Index columns = geometry.columns();
  MatrixXd analytic(points.rows(), columns), numeric(points.rows(), columns);
  MatrixOut out = analytic;
  evaluate(geometry, points, state, residual, &out);
  assert(residual == residual_at(geometry, points, state));
  const double step = 1e-5;
  for (Eigen::Index i = 0; i < columns; ++i) {
    const VectorXd tangent = step * VectorXd::Unit(columns, i);
    numeric.col(i) = (residual_at(geometry, points, retract(state, tangent)) -
                      residual_at(geometry, points, retract(state, -tangent))) /
                     (2.0 * step);
  }
  assert(residual.cwiseAbs().maxCoeff() > 1e-6);
  assert(relative_error(analytic, numeric) < 1e-7);
}

GeometricPoints random_statistics() {
  GeometricPoints points;
  for (int i = 0; i < kFrameCount; ++i) {
    points.statistics.push_back(Matrix3::Random().triangularView<Eigen::Upper>());
  }
  return points;
}

ReprojectionPoints random_points() {
  ReprojectionPoints points{
      0.5 * Eigen::Matrix2Xd::Random(2, 10), VectorXd::Random(10).cwiseAbs(), {1, 2, 3, 4}};
  return points;
}

void derivatives_are_right() {
  for (int i = 0; i < 50; ++i) {
    const bool timed = i % 2 == 0;
    State state = random_state();
    if (!timed) state.time_shift = 0.0;
    const Geometry geometry = random_geometry(state, timed);
    check_jacobian(geometry, random_statistics(), state);
    check_jacobian(geometry, random_points(), state);
  }
}

/// A camera at the origin and the line through `point` along `direction`, as seen from there.
Geometry at_origin(const Vector3& point, const Vector3& direction) {
  Matrix3 basis;
  const Vector3 along = direction.normalized();
  const Vector3 foot = point - along * along.dot(point);
  basis.col(1) = along;
  basis.col(2) = -foot.normalized();
  basis.col(0) = along.cross(basis.col(2));
  const LineChart chart{Matrix3::Identity(), Vector3::Zero(), basis, std::atan(1.0 / foot.norm())};
  const FrameMotion rest{0.0, Vector6::Zero(), Matrix6::Zero()};
  return Geometry(chart, Matrix3::Identity(), Vector3::Zero(), {rest}, Vector6::Zero());
}

State at_rest() {
  return {Matrix3::Identity(), Vector3::Zero(), Vector3::Zero(),
          Vector6::Zero(),     Vector3::Zero(), Eigen::Vector4d::Zero()};
}

void degenerate_geometry_is_defined() {
  const GeometricPoints statistics{{Matrix3::Identity()}};
  const ReprojectionPoints point{Eigen::Vector2d(0.1, -0.2), VectorXd::Ones(1), {1}};
  VectorXd residual(3);
  MatrixXd jacobian(3, kColumns);

  // In the focal plane: no finite ruling, no information.
  MatrixOut out = jacobian;
  evaluate(at_origin({0.0, 1.0, 0.0}, Vector3::UnitX()), statistics, at_rest(), residual, &out);
  assert(residual.isZero(0.0) && jacobian.isZero(0.0));

  // Behind the camera.
  const Geometry behind = at_origin({0.0, 0.4, -2.0}, Vector3::UnitX());
  VectorXd pair(2);
  MatrixXd pair_jacobian(2, kColumns);
  MatrixOut pair_out = pair_jacobian;
  evaluate(behind, point, at_rest(), pair, &pair_out);
  assert(pair == VectorXd::Constant(2, kBehindCameraResidual) && pair_jacobian.isZero(0.0));

  // In front of it, on and beside the ruling y = 0.2.
  const Geometry before = at_origin({0.0, 0.4, 2.0}, Vector3::UnitX());
  assert(std::abs(residual_at(before, point, at_rest()).norm() - 0.4) < 1e-12);

  // Not a number stays that.
  State broken = at_rest();
  broken.line[0] = std::numeric_limits<double>::quiet_NaN();
  assert(std::isnan(residual_at(before, statistics, broken)[0]));
  assert(std::isnan(residual_at(before, point, broken)[0]));
}

void wrong_arguments_are_refused() {
  const Pose origin;
  const Vector3 x = Vector3::UnitX(), zero = Vector3::Zero();
  assert(throws([&] { chart_from_plucker(origin, zero, zero); }));
  assert(throws([&] { chart_from_points(origin, x, x); }));
  const LineChart through_centre = chart_from_points(origin, x, 2.0 * x);
  assert(
      throws([&] { reanchor(through_centre, Vector4::Zero(), {Matrix3::Identity(), 3.0 * x}); }));
  const LineChart far = chart_from_plucker(origin, x, zero);
  assert(throws([&] { closest_point(far, Vector4::Zero()); }));
  PointRows same(2, 2);
  same << 0.1, 0.2, 0.1, 0.2;
  assert(throws([&] { line_from_ruling(origin, same, 0.5); }));
  assert(throws([&] { line_from_ruling(origin, same.topRows(1), 0.5); }));
  same(1, 0) = 0.3;
  assert(!throws([&] { line_from_ruling(origin, same, 0.5); }));
  assert(throws([&] { line_from_ruling(origin, same, -0.5); }));
  assert(throws([] { compress_points({PointRows(0, 2)}); }));
  assert(throws([] { compress_points({}); }));
  assert(throws([] { individual_points({}); }));
  assert(!throws([&] { triangulate_line({origin}, std::vector<PointRows>{same}); }));
  assert(throws([&] { triangulate_line({origin, origin}, std::vector<PointRows>{same}); }));
  assert(throws([&] { triangulate_line({origin}, std::vector<PointRows>{same}, 0.0); }));
  assert(throws([&] { triangulate_line({origin}, std::vector<PointRows>{same.topRows(1)}); }));
  assert(throws([&] { individual_points({same}, 0.0); }));
}

void write_line(const LineChart& chart) {
  write(chart.basis);
  write(chart.angle);
}

void write_line(const OfLine& found) {
  write(found.value);
  write(found.by_line);
}

void write_chart() {
  const Pose anchor = read_plain_pose(), other = read_plain_pose();
  const Vector3 moment = read_fixed<3>(), along = read_fixed<3>(), to = read_fixed<3>();
  const Vector4 delta = read_fixed<4>();
  const LineChart chart = chart_from_plucker(anchor, moment, along);
  const PlueckerPair pair = plucker(chart, delta);
  write(pair.value);
  write(pair.by_line);
  write_line(direction(chart, delta));
  write_line(closest_point(chart, delta));
  write_line(closest_point(chart, delta, to));
  const Reanchored found = reanchor(chart, delta, other);
  write_line(chart);
  write_line(found.chart);
  write(found.by_line);
  const PointRows points = read_rows(2);
  write_line(line_from_ruling(anchor, points, read_number()));
  write(local(found.chart, pair.value.head<3>(), pair.value.tail<3>()));
  const Vector4 far = read_fixed<4>();
  const Wrapped near = wrapped(chart, far);
  write(near.line);
  write(near.by_line);
  write(is_far(far) ? 1.0 : 0.0);
  const Reanchored centred = recentred(chart, far);
  write_line(centred.chart);
  write(centred.by_line);
}

void write_triangulation() {
  std::vector<Pose> cameras(read_count());
  for (Pose& camera : cameras) camera = read_plain_pose();
  const std::vector<PointRows> frames = read_frames();
  const LineTriangulation found = triangulate_line(cameras, frames, read_number());
  write_line(found.chart);
  write(found.covariance);
  write(found.rms);
  write(static_cast<double>(found.status));
  assert(found.determined() == found.reason.empty());
}

void write_motions() {
  const Eigen::MatrixXd samples = read_rows(7).transpose();  // time, force, rate
  const Eigen::VectorXd times = samples.row(0);
  const Eigen::Matrix3Xd force = samples.middleRows<3>(1), rate = samples.bottomRows<3>();
  const double state_time = read_number();
  const Eigen::VectorXd at = read_rows(1);
  const Vector6 bias = read_fixed<6>();
  const Eigen::Index n = times.size();
  const FrameMotions motions =
      preintegrate_frames({{times.data(), n}, {force.data(), 3, n}, {rate.data(), 3, n}},
                          state_time, {at.data(), at.data() + at.size()}, bias, true);
  const Pose start = read_plain_pose();
  State state{start.rotation, start.position, read_fixed<3>(), {}, {0.0, 0.0, -9.81}, {}};
  state.bias = read_fixed<6>();
  state.time_shift = read_number();
  for (std::size_t i = 0; i < motions.frames.size(); ++i) {
    const FrameMotion frame = motions.select({i}).frames.front();
    write(frame.elapsed);
    write(frame.preintegrated);
    write(frame.bias_jacobian);
    write(frame.time_jacobian);
    const Pose pose = frame_pose(motions, i, state);
    write(pose.rotation);
    write(pose.position);
  }
}

void write_points() {
  const std::vector<PointRows> frames = read_frames();
  const double cap = read_number();
  const GeometricPoints compressed = compress_points(frames, cap);
  for (const Matrix3& C : compressed.statistics) write(C.transpose() * C);
  for (const Matrix3& C : without_scatter(compressed).statistics) {
    write(C.transpose() * C);
    write(C.row(2));
  }
  const ReprojectionPoints individual = individual_points(frames, cap);
  write(individual.points.transpose());
  write(individual.sqrt_weights);
  for (const Eigen::Index count : individual.counts) write(static_cast<double>(count));
  write(middles(compressed));
  write(middles(individual));
  write(total_weight(compressed));
  write(total_weight(individual));
}

}  // namespace

int main(int count, char**) {
  if (count == 1) {
    derivatives_are_right();
    degenerate_geometry_is_defined();
    preintegration_differentiates_by_the_bias();
    wrong_arguments_are_refused();
    wrong_imu_samples_are_refused();
    shifts_in_time_take_motions_that_know_them();
    std::puts("passed");
    return 0;
  }
  for (double kind; std::cin >> kind;) {
    if (kind == 0.0) write_chart();
    if (kind == 1.0) write_motions();
    if (kind == 2.0) write_points();
    if (kind == 3.0) write_triangulation();
  }
  return 0;
}
