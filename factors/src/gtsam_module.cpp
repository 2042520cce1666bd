// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// The Python module `ruledgraph_factors._gtsam`: the C++ factors for the Python module of a GTSAM
// that the user built; `_gtsam.pyi` documents it, CPP.md says how to build it.

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ruledgraph/gtsam/line_observation.hpp"

#if GTSAM_VERSION_NUMERIC < 40300
#error "The factors for GTSAM's Python module need GTSAM 4.3."
#endif

namespace py = pybind11;

namespace {

using namespace ruledgraph;

/// The C++ factor of any form; it knows the Python spec it was built from, as its copies do.
class SpecFactor : public LineObservation {
 public:
  SpecFactor(const py::object& spec, Form form, const gtsam::SharedNoiseModel& noise_model,
             const gtsam::KeyVector& keys, const CameraKeys& camera, gtsam::Key line_key,
             RuledSurface surface, const Vector3& gravity)
      : LineObservation(form, noise_model, keys, camera, line_key, std::move(surface), gravity),
        spec_(new py::object(spec), &forget) {}

  py::object spec() const { return spec_ ? *spec_ : py::none(); }

  gtsam::NonlinearFactor::shared_ptr clone() const override {
    return std::make_shared<SpecFactor>(*this);
  }

  gtsam::NonlinearFactor::shared_ptr with_line(gtsam::Key line_key,
                                               const LineChart& chart) const override {
    const auto copy = std::make_shared<SpecFactor>(*this);
    copy->move_line(line_key, chart);
    copy->spec_.reset();
    return copy;
  }

 private:
  static void forget(py::object* spec) {
    const py::gil_scoped_acquire lock;
    delete spec;
  }

  std::shared_ptr<py::object> spec_;
};

/// By its name in Python.
LineObservation::Form form_of(const std::string& name) {
  using Form = LineObservation::Form;
  static const std::map<std::string, Form> kForms{
      {"node", Form::kNode},
      {"node_gravity_direction", Form::kGravityDirection},
      {"node_gravity_vector", Form::kGravityVector},
      {"pose", Form::kPose},
  };
  return kForms.at(name);
}

/// The matrices of an array (n, Rows, Columns), or the vectors of one (n, Rows).
template <int Rows, int Columns>
std::vector<Eigen::Matrix<double, Rows, Columns>> each(const py::object& array) {
  constexpr int kOrder = Columns == 1 ? Eigen::ColMajor : Eigen::RowMajor;
  const py::array_t<double, py::array::c_style | py::array::forcecast> all(array);
  if (all.ndim() < 2 || all.size() != all.shape(0) * Rows * Columns) {
    throw std::invalid_argument("ruledgraph: an array of the spec has the wrong shape");
  }
  std::vector<Eigen::Matrix<double, Rows, Columns>> found;
  for (py::ssize_t i = 0; i < all.shape(0); ++i) {
    found.emplace_back(Eigen::Map<const Eigen::Matrix<double, Rows, Columns, kOrder>>(
        all.data() + i * Rows * Columns));
  }
  return found;
}

FrameMotions motions_of(const py::dict& arrays) {
  const auto elapsed = arrays["elapsed"].cast<std::vector<double>>();
  const auto preintegrated = each<9, 1>(arrays["preintegrated"]);
  const auto bias_jacobian = each<9, 6>(arrays["bias_jacobian"]);
  FrameMotions found{{}, arrays["bias"].cast<Vector6>(), arrays.contains("time_jacobian")};
  for (std::size_t i = 0; i < elapsed.size(); ++i) {
    // The residuals do not depend on dv, the last three.
    found.frames.push_back(
        {elapsed[i], preintegrated.at(i).head<6>(), bias_jacobian.at(i).topRows<6>()});
  }
  if (!found.timed) return found;
  const auto time_jacobian = each<6, 1>(arrays["time_jacobian"]);
  for (std::size_t i = 0; i < elapsed.size(); ++i) {
    found.frames[i].time_jacobian = time_jacobian.at(i);
  }
  return found;
}

Points points_of(const py::dict& arrays, std::size_t frames) {
  if (arrays.contains("statistics")) return GeometricPoints{each<3, 3>(arrays["statistics"])};
  ReprojectionPoints found{arrays["points"].cast<Eigen::MatrixX2d>().transpose(),
                           arrays["sqrt_weights"].cast<Eigen::VectorXd>(),
                           std::vector<Eigen::Index>(frames, 0)};
  for (const auto frame : arrays["frame"].cast<std::vector<std::size_t>>()) {
    ++found.counts.at(frame);
  }
  return found;
}

LineChart chart_of(const py::dict& arrays) {
  const auto anchor = arrays["world_T_anchor"].cast<Eigen::Matrix4d>();
  return {anchor.topLeftCorner<3, 3>(), anchor.topRightCorner<3, 1>(),
          arrays["basis"].cast<Matrix3>(), arrays["angle"].cast<double>()};
}

std::shared_ptr<SpecFactor> native_factor(const py::object& spec, const py::dict& arrays) {
  const FrameMotions motions = motions_of(arrays);
  const gtsam::Pose3 body_T_cam(arrays["body_T_cam"].cast<gtsam::Matrix>());
  auto keys = spec.attr("keys").cast<gtsam::KeyVector>();
  const gtsam::Key line_key = keys.back();
  keys.pop_back();
  const auto variables = spec.attr("camera_variables").cast<std::vector<std::string>>();
  CameraKeys camera;
  for (auto name = variables.rbegin(); name != variables.rend(); ++name) {
    auto& key = *name == "time" ? camera.time : *name == "focal" ? camera.focal : camera.extrinsics;
    key = keys.back();
    keys.pop_back();
  }
  return std::make_shared<SpecFactor>(
      spec, form_of(spec.attr("form").cast<std::string>()),
      spec.attr("noise_model").cast<gtsam::SharedNoiseModel>(), keys, camera, line_key,
      RuledSurface(chart_of(arrays), motions, points_of(arrays, motions.frames.size()), body_T_cam),
      arrays["gravity"].cast<Vector3>());
}

}  // namespace

PYBIND11_MODULE(_gtsam, module) {
  py::module_::import("gtsam");  // registers the base class
  py::class_<SpecFactor, gtsam::NoiseModelFactor, std::shared_ptr<SpecFactor>>(module,
                                                                               "RuledSurfaceFactor")
      .def_property_readonly("spec", &SpecFactor::spec);
  module.def("native_factor", &native_factor, py::arg("spec"), py::arg("arrays"));
}
