// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
//
// A whole visual-inertial graph: CombinedImuFactor, projections of points, and lines; a state every
// 0.1 s for 3 s, solved by Levenberg-Marquardt at once and by ISAM2 state by state. The sensors are
// simulated. `tools/benchmarks/foreign_vio.py` is the same in Python.
//
//     vio [FILE]
//
// Prints the position RMSE and the time of each solver, and what a line factor costs; FILE gets the
// estimates, all digits.

#include <gtsam/geometry/Cal3_S2.h>
#include <gtsam/inference/Symbol.h>
#include <gtsam/navigation/CombinedImuFactor.h>
#include <gtsam/nonlinear/ISAM2.h>
#include <gtsam/nonlinear/LevenbergMarquardtOptimizer.h>
#include <gtsam/nonlinear/NonlinearFactorGraph.h>
#include <gtsam/slam/ProjectionFactor.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "ruledgraph/gtsam/line_factors.hpp"
#include "ruledgraph/gtsam/ruled_surface_factor.hpp"
#include "ruledgraph/gtsam/solvers.hpp"
#include "ruledgraph/new_line.hpp"

namespace rg = ruledgraph;
using gtsam::Vector3;
using gtsam::symbol_shorthand::B;
using gtsam::symbol_shorthand::L;
using gtsam::symbol_shorthand::P;
using gtsam::symbol_shorthand::V;
using gtsam::symbol_shorthand::X;

namespace {

constexpr int kStates = 31, kFrames = 9, kPoints = 5, kLines = 12, kEdgePoints = 20;
constexpr int kSamples = 621;  // of the IMU, at 200 Hz
constexpr double kFocal = 425.0;
constexpr double kForceNoise = 0.02, kRateNoise = 0.002;  // m/s^2, rad/s, of a sample

double state_time(int k) { return 0.1 * k; }

/// Uniform noise of unit variance, the same on every machine.
class Noise {
 public:
  double operator()() {
    state_ = state_ * 6364136223846793005u + 1442695040888963407u;
    return std::sqrt(12.0) * (static_cast<double>(state_ >> 11) / 9007199254740992.0 - 0.5);
  }

 private:
  std::uint64_t state_ = 1;
};

// -- the true motion: a walk along a wall, turning to and fro ------------------------------------

Vector3 turning_axis() { return Vector3(0.3, -0.5, 0.8).normalized(); }

gtsam::NavState truth(double t) {
  const Vector3 position(0.2 * std::sin(1.3 * t), 0.4 * t, 0.15 * std::sin(1.7 * t));
  const Vector3 velocity(0.26 * std::cos(1.3 * t), 0.4, 0.255 * std::cos(1.7 * t));
  const gtsam::Rot3 rotation = gtsam::Rot3::Expmap(0.3 * std::sin(1.1 * t) * turning_axis());
  return gtsam::NavState(rotation, position, velocity);
}

Vector3 true_rate(double t) { return 0.33 * std::cos(1.1 * t) * turning_axis(); }

Vector3 true_force(double t) {
  const Vector3 acceleration(-0.338 * std::sin(1.3 * t), 0.0, -0.4335 * std::sin(1.7 * t));
  return truth(t).attitude().matrix().transpose() * (acceleration + Vector3(0.0, 0.0, 9.81));
}

gtsam::Pose3 body_T_cam() {  // looks along the body's x axis
  gtsam::Matrix3 rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return gtsam::Pose3(gtsam::Rot3(rotation), gtsam::Point3(0.05, 0.02, -0.01));
}

// -- what the sensors see ------------------------------------------------------------------------

struct Recording {
  Eigen::VectorXd imu_times{kSamples};
  Eigen::Matrix3Xd force{3, kSamples}, rate{3, kSamples};
  std::vector<std::array<gtsam::Point2, kPoints>> pixels;             ///< at each state
  std::vector<std::array<std::vector<rg::PointRows>, kLines>> edges;  ///< in the frames after it

  rg::ImuSamples imu() const {
    return {{imu_times.data(), kSamples}, {force.data(), 3, kSamples}, {rate.data(), 3, kSamples}};
  }
};

Vector3 point(int j) { return {3.5 + 0.3 * j, -0.4 + 0.5 * j, 0.6 * std::sin(2.0 * j)}; }

std::array<Vector3, 2> edge(int i) {
  const Vector3 middle(3.0 + 0.12 * i, -0.6 + 0.2 * i, 0.7 * std::cos(1.7 * i));
  const Vector3 half(0.15 * std::sin(3.0 * i), 0.5 * std::cos(1.1 * i), 0.5 * std::sin(1.1 * i));
  return {middle - half, middle + half};
}

gtsam::Vector2 seen(const gtsam::Pose3& world_T_body, const Vector3& at) {
  const Vector3 inside = (world_T_body * body_T_cam()).transformTo(gtsam::Point3(at));
  return {inside.x() / inside.z(), inside.y() / inside.z()};
}

std::vector<double> frame_times(int k) {
  std::vector<double> times;
  for (int i = 0; i < kFrames; ++i) times.push_back(state_time(k) + i / 90.0);
  return times;
}

Recording simulate() {
  Noise noise;
  Recording found;
  for (int i = 0; i < kSamples; ++i) {
    const double t = found.imu_times[i] = 0.005 * i;
    const Vector3 force = true_force(t), rate = true_rate(t);
    for (int j = 0; j < 3; ++j) found.force(j, i) = force[j] + kForceNoise * noise();
    for (int j = 0; j < 3; ++j) found.rate(j, i) = rate[j] + kRateNoise * noise();
  }
  for (int k = 0; k < kStates; ++k) {
    auto& pixels = found.pixels.emplace_back();
    for (int j = 0; j < kPoints; ++j) {
      const gtsam::Vector2 at = kFocal * seen(truth(state_time(k)).pose(), point(j));
      const double x = noise(), y = noise();
      pixels[j] = gtsam::Point2(at.x() + x, at.y() + y);
    }
  }
  for (int k = 0; k + 1 < kStates; ++k) {
    auto& edges = found.edges.emplace_back();
    for (int i = 0; i < kLines; ++i) {
      const auto ends = edge(i);
      for (const double t : frame_times(k)) {
        const gtsam::Pose3 pose = truth(t).pose();
        const gtsam::Vector2 first = seen(pose, ends[0]), last = seen(pose, ends[1]);
        rg::PointRows points(kEdgePoints, 2);
        for (int j = 0; j < kEdgePoints; ++j) {
          const gtsam::Vector2 on = first + j / (kEdgePoints - 1.0) * (last - first);
          const double x = noise(), y = noise();
          points.row(j) << on.x() + 0.5 / kFocal * x, on.y() + 0.5 / kFocal * y;
        }
        edges[i].push_back(points);
      }
    }
  }
  return found;
}

// -- the graph, state by state -------------------------------------------------------------------

/// GTSAM up to 4.3a0 adds an uncertainty of the bias that the graph has already, by default (1
/// m/s^2, 1 rad/s)^2; later versions have no such member.
template <typename Params>
auto drop_initial_bias_covariance(Params& params, int)
    -> decltype(params.biasAccOmegaInt.setZero(), void()) {
  params.biasAccOmegaInt.setZero();
}
template <typename Params>
void drop_initial_bias_covariance(Params&, long) {}

/// What one state adds; `imu` is from the state before.
struct Packet {
  gtsam::NonlinearFactorGraph factors;
  gtsam::Values values;
  gtsam::PreintegratedCombinedMeasurements imu;
};

std::vector<Packet> build(const Recording& recording) {
  const auto params = gtsam::PreintegrationCombinedParams::MakeSharedU(9.81);
  const gtsam::Matrix3 one = gtsam::Matrix3::Identity();
  params->setAccelerometerCovariance(kForceNoise * kForceNoise * 0.005 * one);
  params->setGyroscopeCovariance(kRateNoise * kRateNoise * 0.005 * one);
  params->setIntegrationCovariance(1e-12 * one);
  params->biasAccCovariance = 1e-6 * one;
  params->biasOmegaCovariance = 1e-8 * one;
  drop_initial_bias_covariance(*params, 0);
  const gtsam::imuBias::ConstantBias no_bias;
  const auto sigma = [](std::size_t dim, double value) {
    return gtsam::noiseModel::Isotropic::Sigma(dim, value);
  };
  const rg::ImuSamples imu = recording.imu();

  std::vector<Packet> packets;
  std::array<rg::LineChart, kLines> charts;
  for (int k = 0; k < kStates; ++k) {
    Packet packet{{}, {}, gtsam::PreintegratedCombinedMeasurements(params, no_bias)};
    auto& graph = packet.factors;
    if (k == 0) {
      const gtsam::NavState start = truth(0.0);
      packet.values.insert(X(0), start.pose());
      packet.values.insert(V(0), gtsam::Vector3(start.velocity()));
      packet.values.insert(B(0), no_bias);
      graph.addPrior(X(0), start.pose(), sigma(6, 1e-4));
      graph.addPrior(V(0), gtsam::Vector3(start.velocity()), sigma(3, 0.05));
      graph.addPrior(B(0), no_bias, sigma(6, 0.02));
      for (int j = 0; j < kPoints; ++j) {
        const gtsam::Point3 guess = point(j) + Vector3(0.1, -0.1, 0.1);
        packet.values.insert(P(j), guess);
        graph.addPrior(P(j), guess, sigma(3, 1.0));
      }
    } else {
      // The segments that the frames use, too: states and frames see the same motion.
      const rg::ImuSegments segments =
          imu.segments({state_time(k - 1), state_time(k)}, Vector3::Zero(), Vector3::Zero());
      for (Eigen::Index i = 0; i < segments.force.cols(); ++i) {
        const auto at = static_cast<std::size_t>(i);
        packet.imu.integrateMeasurement(segments.force.col(i), segments.rate.col(i),
                                        segments.breaks[at + 1] - segments.breaks[at]);
      }
      graph.add(
          gtsam::CombinedImuFactor(X(k - 1), V(k - 1), X(k), V(k), B(k - 1), B(k), packet.imu));
      // The lines in the frames after the last state.
      const rg::FrameMotions motions =
          rg::preintegrate_frames(imu, state_time(k - 1), frame_times(k - 1), no_bias.vector());
      for (int i = 0; i < kLines; ++i) {
        const auto& frames = recording.edges[k - 1][i];
        if (k == 1) {  // a new line, 4 m away at a guess
          const gtsam::Pose3 first = truth(0.0).pose();
          charts[i] = rg::line_from_ruling(rg::from_gtsam(first * body_T_cam()), frames[0], 0.25);
          packet.values.insert(L(i), gtsam::Vector4(gtsam::Vector4::Zero()));
          const auto wide = gtsam::noiseModel::Diagonal::Sigmas(rg::new_line_sigmas());
          graph.add(rg::NewLineFactor(wide, X(0), L(i), charts[i], first));
        }
        const rg::GeometricPoints points = rg::compress_points(frames);
        graph.add(rg::RuledSurfaceFactor(sigma(points.rows(), 0.5 / kFocal), X(k - 1), V(k - 1),
                                         B(k - 1), L(i), motions, charts[i], points, body_T_cam()));
      }
    }
    const auto calibration =
        gtsam::Cal3_S2::shared_ptr(new gtsam::Cal3_S2(kFocal, kFocal, 0.0, 0.0, 0.0));
    for (int j = 0; j < kPoints; ++j) {
      graph.add(gtsam::GenericProjectionFactor<gtsam::Pose3, gtsam::Point3, gtsam::Cal3_S2>(
          recording.pixels[k][j], sigma(2, 1.0), X(k), P(j), calibration, body_T_cam()));
    }
    packets.push_back(packet);
  }
  return packets;
}

/// The packet's values, and state k as the IMU predicts it from the estimate of the last.
gtsam::Values new_values(int k, const Packet& packet, const gtsam::Values& estimate) {
  gtsam::Values values = packet.values;
  if (k > 0) {
    const auto bias = estimate.at<gtsam::imuBias::ConstantBias>(B(k - 1));
    const gtsam::NavState last(estimate.at<gtsam::Pose3>(X(k - 1)),
                               estimate.at<gtsam::Vector3>(V(k - 1)));
    const gtsam::NavState state = packet.imu.predict(last, bias);
    values.insert(X(k), state.pose());
    values.insert(V(k), gtsam::Vector3(state.velocity()));
    values.insert(B(k), bias);
  }
  return values;
}

gtsam::Values levenberg_marquardt(const std::vector<Packet>& packets) {
  gtsam::NonlinearFactorGraph graph;
  gtsam::Values values;
  for (int k = 0; k < kStates; ++k) {
    graph.push_back(packets[k].factors);
    values.insert(new_values(k, packets[k], values));
  }
  gtsam::LevenbergMarquardtParams params = rg::levenberg_marquardt_params();
  params.setRelativeErrorTol(1e-15);  // to the end, to compare with Python
  params.setAbsoluteErrorTol(1e-15);
  return gtsam::LevenbergMarquardtOptimizer(graph, values, params).optimize();
}

gtsam::Values isam2(const std::vector<Packet>& packets) {
  gtsam::ISAM2 solver(rg::isam2_params());
  gtsam::Values estimate;
  for (int k = 0; k < kStates; ++k) {
    solver.update(packets[k].factors, new_values(k, packets[k], estimate));
    solver.update();
    estimate = solver.calculateEstimate();
  }
  return estimate;
}

double position_rmse(const gtsam::Values& estimate) {
  double sum = 0.0;
  for (int k = 0; k < kStates; ++k) {
    const gtsam::Pose3 pose = estimate.at<gtsam::Pose3>(X(k));
    sum += (pose.translation() - truth(state_time(k)).position()).squaredNorm();
  }
  return std::sqrt(sum / kStates);
}

void write(std::FILE* file, const gtsam::Values& estimate) {
  for (int k = 0; k < kStates; ++k) {
    const gtsam::Matrix pose = estimate.at<gtsam::Pose3>(X(k)).matrix();
    for (int i = 0; i < 12; ++i) std::fprintf(file, "%.17g ", pose(i / 4, i % 4));
    const gtsam::Vector3 velocity = estimate.at<gtsam::Vector3>(V(k));
    for (int i = 0; i < 3; ++i) std::fprintf(file, "%.17g ", velocity[i]);
    std::fprintf(file, "\n");
  }
}

/// Of the processor.
double seconds_since(std::clock_t start) { return 1.0 * (std::clock() - start) / CLOCKS_PER_SEC; }

/// Time to linearise a line factor of nine frames, microseconds; the fastest of many rounds.
double linearize_time(const std::vector<Packet>& packets, const gtsam::Values& values) {
  double fastest = 1e9;
  for (int round = 0; round < 200; ++round) {
    int count = 0;
    const std::clock_t start = std::clock();
    for (const auto& factor : packets[kStates - 1].factors) {
      if (dynamic_cast<const rg::RuledSurfaceFactor*>(&*factor) == nullptr) continue;
      factor->linearize(values);
      ++count;
    }
    fastest = std::min(fastest, 1e6 * seconds_since(start) / count);
  }
  return fastest;
}

}  // namespace

int main(int count, char** arguments) {
  const Recording recording = simulate();
  const std::vector<Packet> packets = build(recording);
  std::FILE* const file = count > 1 ? std::fopen(arguments[1], "w") : nullptr;
  double worst = 0.0;
  const std::pair<const char*, std::function<gtsam::Values(const std::vector<Packet>&)>> solvers[] =
      {{"Levenberg-Marquardt", levenberg_marquardt}, {"ISAM2", isam2}};
  for (const auto& [name, solve] : solvers) {
    const std::clock_t start = std::clock();
    const gtsam::Values estimate = solve(packets);
    const double taken = seconds_since(start);
    const double rmse = position_rmse(estimate);
    std::printf("%-20s %8.3f mm %8.3f s\n", name, 1e3 * rmse, taken);
    worst = std::max(worst, rmse);
    if (file != nullptr) write(file, estimate);
    if (name == solvers[0].first) {
      std::printf("one line factor, nine frames, linearised in %.1f us\n",
                  linearize_time(packets, estimate));
    }
  }
  if (file != nullptr) std::fclose(file);
  return worst < 0.05 ? 0 : 1;
}
