// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The Python module `ruledgraph_factors._native`; `_native.pyi` documents it.

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <vector>

#include "ruledgraph/compress.hpp"
#include "ruledgraph/line_distance.hpp"
#include "ruledgraph/preintegration.hpp"
#include "ruledgraph/triangulation.hpp"
#include "surfaces.hpp"

namespace {

/// Of each frame.
nb::ndarray<nb::numpy, double> compress_frames(Rows<const double, -1, 2> points,
                                               const Eigen::VectorXd& sqrt_weights,
                                               Rows<const std::int64_t, -1> counts) {
  const std::size_t frames = counts.shape(0);
  require(static_cast<std::size_t>(sqrt_weights.size()) == points.shape(0),
          "points and sqrt_weights differ in length");
  auto* statistics = new std::vector<double>(9 * frames, 0.0);
  nb::capsule owner(statistics,
                    [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  Index first = 0;
  for (std::size_t i = 0; i < frames; ++i) {
    const auto count = static_cast<Index>(counts.data()[i]);
    require(count >= 0 && first + count <= sqrt_weights.size(), "counts: not those of the points");
    const RowMajorMap<Eigen::Dynamic, 2> own(points.data() + 2 * first, count, 2);
    Eigen::Map<RowMajor<3, 3>>(statistics->data() + 9 * i) =
        compress(own, sqrt_weights.segment(first, count));
    first += count;
  }
  const std::size_t shape[3] = {frames, 3, 3};
  return nb::ndarray<nb::numpy, double>(statistics->data(), 3, shape, owner);
}

nb::tuple segments(Rows<const double, -1> times, Rows<const double, -1, 3> force,
                   Rows<const double, -1, 3> rate, const std::vector<double>& breaks,
                   const Vector6& bias) {
  const std::size_t count = times.shape(0);
  require(count >= 2 && force.shape(0) == count && rate.shape(0) == count,
          "times, force and rate do not fit together");
  require(!breaks.empty(), "breaks is empty");
  const auto size = static_cast<Index>(count);
  const ImuSamples samples{{times.data(), size}, {force.data(), 3, size}, {rate.data(), 3, size}};
  const ImuSegments found = samples.segments(breaks, bias.head<3>(), bias.tail<3>());
  const auto& all = found.breaks;
  return nb::make_tuple(Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(
                            all.data(), static_cast<Index>(all.size()))),
                        RowMajor<Eigen::Dynamic, 3>(found.force.transpose()),
                        RowMajor<Eigen::Dynamic, 3>(found.rate.transpose()));
}

std::size_t integrate(Rows<const double, -1, 3> force, Rows<const double, -1, 3> rate,
                      const Eigen::VectorXd& dt, Rows<double, -1, 9> delta,
                      Rows<double, -1, 9, 6> d_bias) {
  const auto count = static_cast<std::size_t>(dt.size());
  require(force.shape(0) == count && rate.shape(0) == count && delta.shape(0) == count + 1 &&
              d_bias.shape(0) == count + 1,
          "force, rate, dt, delta and d_bias do not fit together");
  constexpr double kHalfTurn = 3.14159265358979323846;
  Preintegrated motion;
  for (std::size_t i = 0;; ++i) {
    Eigen::Map<Eigen::Matrix<double, 9, 1>>(delta.data() + 9 * i) = motion.delta;
    Eigen::Map<RowMajor<9, 6>>(d_bias.data() + 54 * i) = motion.d_bias;
    if (i == count || motion.delta.head<3>().squaredNorm() > kHalfTurn * kHalfTurn) return i;
    motion.integrate(Eigen::Map<const Vector3>(force.data() + 3 * i),
                     Eigen::Map<const Vector3>(rate.data() + 3 * i), dt[static_cast<Index>(i)]);
  }
}

nb::tuple plucker_pair(const Matrix4d& world_T_anchor, const Matrix3& basis, double angle,
                       const Eigen::Vector4d& delta) {
  const PlueckerPair pair = plucker(make_chart(world_T_anchor, basis, angle), delta);
  return nb::make_tuple(pair.value, pair.by_line);
}

nb::tuple angle_of_line(const Matrix4d& world_T_anchor, const Matrix3& basis, double angle,
                        const Eigen::Vector4d& delta, const Matrix4d& world_T_body) {
  const LineAngle phi =
      line_angle(make_chart(world_T_anchor, basis, angle), delta,
                 world_T_body.topLeftCorner<3, 3>(), world_T_body.topRightCorner<3, 1>());
  return nb::make_tuple(phi.value, phi.pose, phi.line);
}

nb::tuple triangulate(Rows<const double, -1, 4, 4> world_T_cams,
                      Rows<const double, -1, 3, 3> statistics, double sigma) {
  std::vector<Pose> cameras;
  for (std::size_t i = 0; i < world_T_cams.shape(0); ++i) {
    const RowMajorMap<4, 4> camera(world_T_cams.data() + 16 * i);
    cameras.push_back({camera.topLeftCorner<3, 3>(), camera.topRightCorner<3, 1>()});
  }
  const LineTriangulation found = triangulate_line(cameras, geometric_points(statistics), sigma);
  return nb::make_tuple(found.chart.basis, found.chart.angle, found.covariance, found.rms,
                        static_cast<int>(found.status), found.reason);
}

template <typename Surface>
nb::class_<Surface> bind_surface(nb::module_& module, const char* name) {
  return nb::class_<Surface>(module, name)
      .def("evaluate", &Surface::evaluate, nb::arg("world_T_body"), nb::arg("velocity"),
           nb::arg("bias"), nb::arg("gravity"), nb::arg("line"), nb::arg("time_shift"),
           nb::arg("body_T_cam").none(), nb::arg("focal_ratio").none(), nb::arg("residual"),
           nb::arg("jacobian").noconvert().none())
      .def("fit_line", &Surface::fit_line, nb::arg("world_T_body"), nb::arg("velocity"),
           nb::arg("bias"), nb::arg("gravity"), nb::arg("starts"), nb::arg("information"),
           nb::arg("prior"), nb::arg("descents"));
}

}  // namespace

NB_MODULE(_native, module) {
  // Graphs of GTSAM hold factors in Python until the interpreter has ended: no leak of ours.
  nb::set_leak_warnings(false);
  nb::class_<Geometry>(module, "Geometry")
      .def(nb::new_(&make_geometry), nb::arg("world_T_anchor"), nb::arg("basis"), nb::arg("angle"),
           nb::arg("body_T_cam"), nb::arg("elapsed"), nb::arg("preintegrated"),
           nb::arg("bias_jacobian"), nb::arg("bias"), nb::arg("time_jacobian").none());
  bind_surface<GeometricSurface>(module, "GeometricSurface")
      .def(nb::new_(&make_geometric), nb::arg("geometry"), nb::arg("statistics"));
  bind_surface<ReprojectionSurface>(module, "ReprojectionSurface")
      .def(nb::new_(&make_reprojection), nb::arg("geometry"), nb::arg("points"),
           nb::arg("sqrt_weights"), nb::arg("frame"));
  module.def("plucker", &plucker_pair, nb::arg("world_T_anchor"), nb::arg("basis"),
             nb::arg("angle"), nb::arg("delta"));
  module.def("line_angle", &angle_of_line, nb::arg("world_T_anchor"), nb::arg("basis"),
             nb::arg("angle"), nb::arg("delta"), nb::arg("world_T_body"));
  module.def("triangulate_line", &triangulate, nb::arg("world_T_cams"), nb::arg("statistics"),
             nb::arg("sigma"));
  module.def("robust_lines", &robust_lines, nb::arg("surfaces"), nb::arg("precision"),
             nb::arg("chunk"), nb::arg("scales"), nb::arg("world_T_body"), nb::arg("velocity"),
             nb::arg("bias"), nb::arg("gravity"), nb::arg("time_shift"), nb::arg("lines"),
             nb::arg("losses").noconvert(), nb::arg("information").noconvert().none(),
             nb::arg("gradient").noconvert().none());
  module.def("compress", &compress_frames, nb::arg("points"), nb::arg("sqrt_weights"),
             nb::arg("counts"));
  module.def("segments", &segments, nb::arg("times"), nb::arg("force"), nb::arg("rate"),
             nb::arg("breaks"), nb::arg("bias"));
  module.def("integrate", &integrate, nb::arg("force"), nb::arg("rate"), nb::arg("dt"),
             nb::arg("delta").noconvert(), nb::arg("d_bias").noconvert());
}
