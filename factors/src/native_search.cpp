// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The Python module `ruledgraph.edges._native_search`; `_native_search.pyi` documents it.

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ruledgraph/camera.hpp"
#include "ruledgraph/edge_search.hpp"

namespace nb = nanobind;

namespace {

using namespace ruledgraph;

template <typename Scalar, Eigen::Index... Shape>
using Rows = nb::ndarray<const Scalar, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
using PointRows = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;
using Column = Eigen::VectorXd;
using Counts = Eigen::Matrix<std::int64_t, Eigen::Dynamic, 1>;
using Mask = Eigen::Array<bool, Eigen::Dynamic, 1>;

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

Camera make_camera(int width, int height, double fx, double fy, double cx, double cy,
                   const std::string& distortion, const std::vector<double>& coefficients) {
  require(coefficients.size() <= 5, "more than five coefficients");
  Camera camera{width, height, fx, fy, cx, cy, Distortion::kNone, {}};
  if (distortion == "radtan") {
    camera.distortion = Distortion::kRadtan;
  } else if (distortion == "equidistant") {
    camera.distortion = Distortion::kEquidistant;
  } else {
    require(distortion == "none", "unknown distortion model");
  }
  std::copy(coefficients.begin(), coefficients.end(), camera.coefficients.begin());
  return camera;
}

nb::tuple search_all(Rows<float, -1, -1, 2> gradient, const Camera& camera,
                     Rows<double, -1, 2, 2> ends, Rows<double, -1, 2> sigmas,
                     Rows<double, -1> slopes, double beyond) {
  const std::size_t count = ends.shape(0);
  require(sigmas.shape(0) == count && slopes.shape(0) == count,
          "ends, sigmas and slopes differ in length");
  const GradientView view{gradient.data(), static_cast<int>(gradient.shape(1)),
                          static_cast<int>(gradient.shape(0))};
  const auto rows = static_cast<Eigen::Index>(count);
  std::vector<Point> points;
  Counts counts = Counts::Zero(rows);
  PointRows lines = PointRows::Zero(rows, 2);
  Column support = Column::Zero(rows), deviation = Column::Zero(rows), slope = Column::Zero(rows);
  Mask ambiguous = Mask::Constant(rows, false);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const double* end = ends.data() + 4 * i;
    const double* sigma = sigmas.data() + 2 * i;
    require(std::isfinite(sigma[0]) && std::isfinite(sigma[1]), "a sigma is not finite");
    const std::optional<EdgePoints> found =
        search(view, camera,
               {{end[0], end[1]}, {end[2], end[3]}, sigma[0], sigma[1], slopes.data()[i]}, beyond);
    if (!found) continue;
    points.insert(points.end(), found->points.begin(), found->points.end());
    counts[i] = static_cast<std::int64_t>(found->points.size());
    lines.row(i) << found->line.a, found->line.b;
    support[i] = found->support;
    deviation[i] = found->deviation;
    slope[i] = found->slope;
    ambiguous[i] = found->ambiguous;
  }
  // A Point is two doubles, one after the other.
  const PointRows stacked = Eigen::Map<const PointRows>(
      points.empty() ? nullptr : &points.front().x, static_cast<Eigen::Index>(points.size()), 2);
  return nb::make_tuple(std::move(counts), stacked, std::move(lines), std::move(support),
                        std::move(deviation), std::move(slope), std::move(ambiguous));
}

}  // namespace

NB_MODULE(_native_search, module) {
  nb::class_<Camera>(module, "Camera")
      .def(nb::new_(&make_camera), nb::arg("width"), nb::arg("height"), nb::arg("fx"),
           nb::arg("fy"), nb::arg("cx"), nb::arg("cy"), nb::arg("distortion"),
           nb::arg("coefficients"));
  module.def("search_all", &search_all, nb::arg("gradient"), nb::arg("camera"), nb::arg("ends"),
             nb::arg("sigmas"), nb::arg("slopes"), nb::arg("beyond"));
}
