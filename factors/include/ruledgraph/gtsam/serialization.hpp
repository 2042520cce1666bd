// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// Boost serialisation of a factor's constants, empty where GTSAM has none.
#pragma once

#include "ruledgraph/gtsam/compatibility.hpp"

#ifdef RULEDGRAPH_SERIALIZATION

#include <gtsam/base/MatrixSerialization.h>

#include <boost/serialization/access.hpp>
#include <boost/serialization/base_object.hpp>
#include <boost/serialization/nvp.hpp>
#include <boost/serialization/vector.hpp>
#include <utility>
#include <variant>

#include "ruledgraph/ruled_surface.hpp"

namespace ruledgraph {

template <class Archive>
void serialize(Archive& archive, LineChart& chart, unsigned int) {
  using boost::serialization::make_nvp;
  archive& make_nvp("world_R_anchor", chart.world_R_anchor);
  archive& make_nvp("world_t_anchor", chart.world_t_anchor);
  archive& make_nvp("basis", chart.basis);
  archive& make_nvp("angle", chart.angle);
}

template <class Archive>
void serialize(Archive& archive, FrameMotion& motion, unsigned int) {
  using boost::serialization::make_nvp;
  archive& make_nvp("elapsed", motion.elapsed);
  archive& make_nvp("preintegrated", motion.preintegrated);
  archive& make_nvp("bias_jacobian", motion.bias_jacobian);
  archive& make_nvp("time_jacobian", motion.time_jacobian);
}

template <class Archive>
void serialize(Archive& archive, GeometricPoints& points, unsigned int) {
  archive& boost::serialization::make_nvp("statistics", points.statistics);
}

template <class Archive>
void serialize(Archive& archive, ReprojectionPoints& points, unsigned int) {
  using boost::serialization::make_nvp;
  archive& make_nvp("points", points.points);
  archive& make_nvp("sqrt_weights", points.sqrt_weights);
  archive& make_nvp("counts", points.counts);
}

template <class Archive>
void serialize_points(Archive& archive, std::variant<GeometricPoints, ReprojectionPoints>& points) {
  using boost::serialization::make_nvp;
  bool compressed = points.index() == 0;
  archive& make_nvp("compressed", compressed);
  if (Archive::is_loading::value) {
    if (compressed) {
      points = GeometricPoints{};
    } else {
      points = ReprojectionPoints{};
    }
  }
  if (compressed) {
    archive& make_nvp("points", std::get<GeometricPoints>(points));
  } else {
    archive& make_nvp("points", std::get<ReprojectionPoints>(points));
  }
}

template <class Archive>
void serialize(Archive& archive, Geometry& geometry, unsigned int) {
  using boost::serialization::make_nvp;
  LineChart chart = geometry.chart();
  Matrix3 body_R_cam = geometry.body_R_cam();
  Vector3 body_t_cam = geometry.body_t_cam();
  std::vector<FrameMotion> motions = geometry.motions();
  Vector6 bias = geometry.bias();
  bool timed = geometry.timed();
  archive& make_nvp("chart", chart);
  archive& make_nvp("body_R_cam", body_R_cam);
  archive& make_nvp("body_t_cam", body_t_cam);
  archive& make_nvp("motions", motions);
  archive& make_nvp("bias", bias);
  archive& make_nvp("timed", timed);
  if (Archive::is_loading::value) {
    geometry = Geometry(chart, body_R_cam, body_t_cam, std::move(motions), bias, timed);
  }
}

}  // namespace ruledgraph

#endif
