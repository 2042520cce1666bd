// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The Python module `ruledgraph.frontend._native_frame`; `_native_frame.pyi` documents it.

#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
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

#include "camera.hpp"
#include "edge_search.hpp"
#include "gradient.hpp"
#include "prediction.hpp"
#include "ruledgraph/compress.hpp"

namespace nb = nanobind;

namespace {

using namespace ruledgraph;

template <typename Scalar, Eigen::Index... Shape>
using Rows = nb::ndarray<const Scalar, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
using Eigen::Index;
template <int Height, int Width>
using RowMajor = Eigen::Matrix<double, Height, Width, Eigen::RowMajor>;
template <int Width>
using Table = RowMajor<Eigen::Dynamic, Width>;
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
  } else if (distortion == "omni") {
    camera.distortion = Distortion::kOmni;
  } else if (distortion == "eucm") {
    camera.distortion = Distortion::kEucm;
  } else if (distortion == "ds") {
    camera.distortion = Distortion::kDoubleSphere;
  } else {
    require(distortion == "none", "unknown distortion model");
  }
  std::copy(coefficients.begin(), coefficients.end(), camera.coefficients.begin());
  return camera;
}

/// A Point is two doubles, one after the other.
Eigen::Map<const PointRows> in_rows(const std::vector<Point>& points) {
  return {points.empty() ? nullptr : &points.front().x, static_cast<Index>(points.size()), 2};
}

/// Whether a deviation leaves a band that can be searched, px.
bool is_width(double sigma) { return sigma >= 0.0 && sigma <= 1000.0; }

/// With the distance from the border that makes a pixel usable.
struct NativeSettings {
  SearchSettings search;
  double border_px;
};

NativeSettings make_settings(double station_distance_px, int max_stations, int min_points,
                             double min_support, double min_extent, double min_slope,
                             double min_slope_share, int stripe_px, double stripe_share,
                             double vote_px, double inlier_px, double sigma_penalty,
                             double rival_distance_px, double rival_share, double end_growth,
                             double border_px) {
  require(min_points >= 3 && station_distance_px > 0.0 && stripe_px >= 0 && border_px >= 1.0,
          "settings of the search are out of range");
  return {{station_distance_px, max_stations, min_points, min_support, min_extent, min_slope,
           min_slope_share, stripe_px, stripe_share, vote_px, inlier_px, sigma_penalty,
           rival_distance_px, rival_share, end_growth},
          border_px};
}

void write_gradient(Rows<std::uint8_t, -1, -1> image,
                    nb::ndarray<float, nb::shape<-1, -1, 2>, nb::c_contig, nb::device::cpu> xy,
                    double blur) {
  require(xy.shape(0) == image.shape(0) && xy.shape(1) == image.shape(1),
          "image and xy differ in size");
  const nb::gil_scoped_release release;
  ruledgraph::gradient(image.data(), static_cast<int>(image.shape(1)),
                       static_cast<int>(image.shape(0)), blur, xy.data());
}

nb::tuple search_all(Rows<float, -1, -1, 2> gradient, const Camera& camera,
                     const NativeSettings& settings, Rows<double, -1, 2, 2> ends,
                     Rows<double, -1, 2> sigmas, Rows<double, -1> slopes, double beyond,
                     const std::optional<Rows<double, -1, 2>>& bows) {
  const std::size_t count = ends.shape(0);
  require(
      sigmas.shape(0) == count && slopes.shape(0) == count && (!bows || bows->shape(0) == count),
      "ends, sigmas, slopes and bows differ in length");
  const GradientView view{gradient.data(), static_cast<int>(gradient.shape(1)),
                          static_cast<int>(gradient.shape(0)), settings.border_px};
  const auto rows = static_cast<Index>(count);
  std::vector<Point> points;
  Counts counts = Counts::Zero(rows);
  Table<4> moved = Table<4>::Zero(rows, 4);
  Table<9> statistics = Table<9>::Zero(rows, 9);
  Table<2> lines = Table<2>::Zero(rows, 2);
  Column support = Column::Zero(rows), deviation = Column::Zero(rows), slope = Column::Zero(rows);
  Mask ambiguous = Mask::Constant(rows, false);
  {
    // Meanwhile others may use the interpreter: it takes as long as all else in a frame.
    const nb::gil_scoped_release release;
    for (Index i = 0; i < rows; ++i) {
      const double* end = ends.data() + 4 * i;
      const double* sigma = sigmas.data() + 2 * i;
      require(is_width(sigma[0]) && is_width(sigma[1]), "a sigma is not from 0 to 1000 px");
      const double* bow = bows ? bows->data() + 2 * i : nullptr;
      const std::optional<EdgePoints> found =
          search(view, camera,
                 {{end[0], end[1]},
                  {end[2], end[3]},
                  sigma[0],
                  sigma[1],
                  slopes.data()[i],
                  bow ? Point{bow[0], bow[1]} : Point{0.0, 0.0}},
                 beyond, settings.search);
      if (!found) continue;
      points.insert(points.end(), found->points.begin(), found->points.end());
      counts[i] = static_cast<Index>(found->points.size());
      moved.row(i) << found->first.x, found->first.y, found->second.x, found->second.y;
      const RowMajor<3, 3> C = compress(in_rows(found->points), Column::Ones(counts[i]));
      statistics.row(i) = Eigen::Map<const Eigen::RowVectorXd>(C.data(), 9);
      lines.row(i) << found->line.a, found->line.b;
      support[i] = found->support;
      deviation[i] = found->deviation;
      slope[i] = found->slope;
      ambiguous[i] = found->ambiguous;
    }
  }
  return nb::make_tuple(std::move(counts), PointRows(in_rows(points)), std::move(moved),
                        std::move(statistics), std::move(lines), std::move(support),
                        std::move(deviation), std::move(slope), std::move(ambiguous));
}

CameraPose pose(const Eigen::Matrix4d& world_T_cam) {
  return {world_T_cam.topLeftCorner<3, 3>(), world_T_cam.topRightCorner<3, 1>()};
}

nb::tuple predict_all(Rows<double, -1, 6> plucker, Rows<double, -1, 6, 4> by_delta,
                      Rows<double, -1, 4, 4> covariances, Rows<double, -1, 2, 2> seen,
                      Rows<double, -1> floors, const Eigen::Matrix4d& world_T_before,
                      const Eigen::Matrix4d& world_T_cam, Rows<double, -1, 2, 2> ends,
                      Rows<double, -1, 2> sigmas, double focal, double max_sigma, double nearest) {
  const std::size_t count = plucker.shape(0);
  require(by_delta.shape(0) == count && covariances.shape(0) == count && seen.shape(0) == count &&
              floors.shape(0) == count && ends.shape(0) == count && sigmas.shape(0) == count,
          "not one of each for every line");
  const CameraPose before = pose(world_T_before), now = pose(world_T_cam);
  Table<4> found_ends(count, 4);
  Table<2> found_sigmas(count, 2);
  for (std::size_t i = 0; i < count; ++i) {
    const double* pair = plucker.data() + 6 * i;
    const double* slopes = by_delta.data() + 24 * i;
    const UncertainLine line{Eigen::Map<const Vector3>(pair),
                             Eigen::Map<const Vector3>(pair + 3),
                             Eigen::Map<const RowMajor<3, 4>>(slopes),
                             Eigen::Map<const RowMajor<3, 4>>(slopes + 12),
                             Eigen::Map<const RowMajor<4, 4>>(covariances.data() + 16 * i),
                             Eigen::Map<const RowMajor<2, 2>>(seen.data() + 4 * i),
                             floors.data()[i]};
    const Predicted otherwise{Eigen::Map<const RowMajor<2, 2>>(ends.data() + 4 * i),
                              Eigen::Map<const Eigen::Vector2d>(sigmas.data() + 2 * i)};
    const Predicted found = predict(line, before, now, otherwise, focal, {max_sigma, nearest});
    const auto row = static_cast<Index>(i);
    found_ends.row(row) << found.ends.row(0), found.ends.row(1);
    found_sigmas.row(row) = found.sigmas.transpose();
  }
  return nb::make_tuple(std::move(found_ends), std::move(found_sigmas));
}

Table<4> rotate_all(Rows<double, -1, 2, 2> ends, const Eigen::Matrix3d& cam_R_before,
                    Rows<double, -1, 2> moved) {
  const std::size_t count = ends.shape(0);
  require(moved.shape(0) == count, "ends and moved differ in length");
  Table<4> found(count, 4);
  for (std::size_t i = 0; i < count; ++i) {
    const Segment now = turned(Eigen::Map<const RowMajor<2, 2>>(ends.data() + 4 * i), cam_R_before,
                               Eigen::Map<const Eigen::Vector2d>(moved.data() + 2 * i));
    found.row(static_cast<Index>(i)) << now.row(0), now.row(1);
  }
  return found;
}

nb::tuple clip_all(Rows<double, -1, 2, 2> ends, const Eigen::Vector2d& low,
                   const Eigen::Vector2d& high) {
  const std::size_t count = ends.shape(0);
  Table<4> parts(count, 4);
  Mask visible(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto row = static_cast<Index>(i);
    const auto [part, is_visible] = part_in_view(
        Eigen::Map<const RowMajor<2, 2>>(ends.data() + 4 * i), low.transpose(), high.transpose());
    parts.row(row) << part.row(0), part.row(1);
    visible[row] = is_visible;
  }
  return nb::make_tuple(std::move(parts), std::move(visible));
}

}  // namespace

NB_MODULE(_native_frame, module) {
  nb::class_<Camera>(module, "Camera")
      .def(nb::new_(&make_camera), nb::arg("width"), nb::arg("height"), nb::arg("fx"),
           nb::arg("fy"), nb::arg("cx"), nb::arg("cy"), nb::arg("distortion"),
           nb::arg("coefficients"));
  nb::class_<NativeSettings>(module, "SearchSettings")
      .def(nb::new_(&make_settings), nb::arg("station_distance_px"), nb::arg("max_stations"),
           nb::arg("min_points"), nb::arg("min_support"), nb::arg("min_extent"),
           nb::arg("min_slope"), nb::arg("min_slope_share"), nb::arg("stripe_px"),
           nb::arg("stripe_share"), nb::arg("vote_px"), nb::arg("inlier_px"),
           nb::arg("sigma_penalty"), nb::arg("rival_distance_px"), nb::arg("rival_share"),
           nb::arg("end_growth"), nb::arg("border_px"));
  module.def("gradient", &write_gradient, nb::arg("image"), nb::arg("xy").noconvert(),
             nb::arg("blur"));
  module.def("search_all", &search_all, nb::arg("gradient"), nb::arg("camera"), nb::arg("settings"),
             nb::arg("ends"), nb::arg("sigmas"), nb::arg("slopes"), nb::arg("beyond"),
             nb::arg("bows") = nb::none());
  module.def("predict_all", &predict_all, nb::arg("plucker"), nb::arg("by_delta"),
             nb::arg("covariances"), nb::arg("seen"), nb::arg("floors"), nb::arg("world_T_before"),
             nb::arg("world_T_cam"), nb::arg("ends"), nb::arg("sigmas"), nb::arg("focal"),
             nb::arg("max_sigma"), nb::arg("nearest"));
  module.def("rotate_all", &rotate_all, nb::arg("ends"), nb::arg("cam_R_before"), nb::arg("moved"));
  module.def("clip_all", &clip_all, nb::arg("ends"), nb::arg("low"), nb::arg("high"));
}
