# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A whole foreign graph in Python and, if its program is given, the same in C++.

31 states with `CombinedImuFactor`s, five points and 360 line factors of nine frames each, the
simulation of `factors/examples/vio.cpp` number by number:

    python tools/benchmarks/foreign_vio.py [PATH OF vio]

Prints the position RMSE and the processor time of each solver, the best of five runs, the same for
C++ (one run as printed, and the fastest of five), and how far apart the estimates of both are.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, P, V, X

import ruledgraph_factors as rf
from ruledgraph.core.arrays import FloatArray

STATES, FRAMES, POINTS, LINES, EDGE_POINTS = 31, 9, 5, 12, 20
SAMPLES = 621
FOCAL = 425.0  # px
FORCE_NOISE, RATE_NOISE = 0.02, 0.002  # m/s^2, rad/s, of a sample
AXIS = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
BODY_T_CAM = gtsam.Pose3(
    gtsam.Rot3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    np.array([0.05, 0.02, -0.01]),
)
GRAVITY_REACTION = np.array([0.0, 0.0, 9.81])
POINT_ERROR = np.array([0.1, -0.1, 0.1])  # of the initial values, m
NO_BIAS = gtsam.imuBias.ConstantBias()
RUNS = 5


def noise() -> Iterator[float]:
    """Uniform, of unit variance, the same on every machine."""
    state = 1
    while True:
        state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
        yield float(np.sqrt(12.0) * ((state >> 11) / 2**53 - 0.5))


def state_time(k: int) -> float:
    """Of state k, s."""
    return 0.1 * k


def frame_times(k: int) -> list[float]:
    """Of the frames from state k on, s."""
    return [state_time(k) + i / 90.0 for i in range(FRAMES)]


def truth(t: float) -> gtsam.NavState:
    """The body's state at a time (s)."""
    position = np.array([0.2 * np.sin(1.3 * t), 0.4 * t, 0.15 * np.sin(1.7 * t)])
    velocity = np.array([0.26 * np.cos(1.3 * t), 0.4, 0.255 * np.cos(1.7 * t)])
    rotation = gtsam.Rot3.Expmap(0.3 * np.sin(1.1 * t) * AXIS)
    return gtsam.NavState(rotation, position, velocity)


def inertial(t: float) -> FloatArray:
    """Specific force (m/s^2) and rate (rad/s), (6,)."""
    acceleration = np.array([-0.338 * np.sin(1.3 * t), 0.0, -0.4335 * np.sin(1.7 * t)])
    force = truth(t).attitude().matrix().T @ (acceleration + GRAVITY_REACTION)
    return np.concatenate([force, 0.33 * np.cos(1.1 * t) * AXIS])


def point(j: int) -> FloatArray:
    """World position of a landmark, m."""
    return np.array([3.5 + 0.3 * j, -0.4 + 0.5 * j, 0.6 * np.sin(2.0 * j)])


def edge(i: int) -> tuple[FloatArray, FloatArray]:
    """World positions of an edge's ends, m."""
    middle = np.array([3.0 + 0.12 * i, -0.6 + 0.2 * i, 0.7 * np.cos(1.7 * i)])
    half = np.array([0.15 * np.sin(3.0 * i), 0.5 * np.cos(1.1 * i), 0.5 * np.sin(1.1 * i)])
    return middle - half, middle + half


def seen(world_T_body: gtsam.Pose3, at: FloatArray) -> FloatArray:
    """Normalised image point, (2,)."""
    inside = (world_T_body * BODY_T_CAM).transformTo(at)
    return np.asarray(inside[:2] / inside[2])


@dataclass
class Recording:
    """What the sensors saw."""

    imu: rf.ImuSamples
    pixels: FloatArray
    """At each state, (states, points, 2)."""
    edges: list[list[list[FloatArray]]]
    """Of state, line and frame, normalised points (20, 2)."""


def simulate() -> Recording:
    """The recording; there is only one."""
    random = noise()
    sigmas = np.repeat([FORCE_NOISE, RATE_NOISE], 3)
    times = 0.005 * np.arange(SAMPLES)
    samples = np.array([inertial(t) + sigmas * [next(random) for _ in range(6)] for t in times])
    pixels = np.array(
        [
            FOCAL * seen(truth(state_time(k)).pose(), point(j)) + [next(random), next(random)]
            for k in range(STATES)
            for j in range(POINTS)
        ]
    ).reshape(STATES, POINTS, 2)
    edges: list[list[list[FloatArray]]] = []
    along = np.arange(EDGE_POINTS)[:, None] / (EDGE_POINTS - 1.0)
    for k in range(STATES - 1):
        edges.append([])
        for i in range(LINES):
            frames = []
            for t in frame_times(k):
                first, last = (seen(truth(t).pose(), end) for end in edge(i))
                errors = [[next(random), next(random)] for _ in range(EDGE_POINTS)]
                frames.append(first + along * (last - first) + 0.5 / FOCAL * np.array(errors))
            edges[-1].append(frames)
    return Recording(rf.ImuSamples(times, samples[:, 3:], samples[:, :3]), pixels, edges)


@dataclass
class Packet:
    """What one state adds to the graph; `imu` is from the state before."""

    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    imu: gtsam.PreintegratedCombinedMeasurements


def build(recording: Recording) -> list[Packet]:
    """The graph, state by state."""
    params = gtsam.PreintegrationCombinedParams.MakeSharedU(9.81)
    params.setAccelerometerCovariance(FORCE_NOISE**2 * 0.005 * np.eye(3))
    params.setGyroscopeCovariance(RATE_NOISE**2 * 0.005 * np.eye(3))
    params.setIntegrationCovariance(1e-12 * np.eye(3))
    params.setBiasAccCovariance(1e-6 * np.eye(3))
    params.setBiasOmegaCovariance(1e-8 * np.eye(3))
    packets = []
    charts: list[rf.LineChart] = []
    calibration = gtsam.Cal3_S2(FOCAL, FOCAL, 0.0, 0.0, 0.0)
    for k in range(STATES):
        imu = gtsam.PreintegratedCombinedMeasurements(params, NO_BIAS)
        packet = Packet(gtsam.NonlinearFactorGraph(), gtsam.Values(), imu)
        if k == 0:
            add_first_state(packet)
        else:
            for segment in recording.imu.segments(state_time(k - 1), state_time(k), bias=NO_BIAS):
                imu.integrateMeasurement(*segment)
            keys = (X(k - 1), V(k - 1), X(k), V(k), B(k - 1), B(k))
            packet.factors.add(gtsam.CombinedImuFactor(*keys, imu))
            add_lines(packet, recording, k - 1, charts)
        for j, pixel in enumerate(recording.pixels[k]):
            noise_model = noiseModel.Isotropic.Sigma(2, 1.0)
            projection = (pixel, noise_model, X(k), P(j), calibration, BODY_T_CAM)
            packet.factors.add(gtsam.GenericProjectionFactorCal3_S2(*projection))
        packets.append(packet)
    return packets


def add_first_state(packet: Packet) -> None:
    """Priors and initial values of the first state and the points."""
    start = truth(0.0)
    packet.values.insert(X(0), start.pose())
    packet.values.insert(V(0), start.velocity())
    packet.values.insert(B(0), NO_BIAS)
    packet.factors.addPriorPose3(X(0), start.pose(), noiseModel.Isotropic.Sigma(6, 1e-4))
    packet.factors.addPriorVector(V(0), start.velocity(), noiseModel.Isotropic.Sigma(3, 0.05))
    packet.factors.addPriorConstantBias(B(0), NO_BIAS, noiseModel.Isotropic.Sigma(6, 0.02))
    for j in range(POINTS):
        guess = point(j) + POINT_ERROR
        packet.values.insert(P(j), guess)
        packet.factors.addPriorPoint3(P(j), guess, noiseModel.Isotropic.Sigma(3, 1.0))


def add_lines(packet: Packet, recording: Recording, k: int, charts: list[rf.LineChart]) -> None:
    """The lines in the frames from state k on."""
    motion = rf.preintegrate_frames(recording.imu, state_time(k), frame_times(k), NO_BIAS)
    for i, frames in enumerate(recording.edges[k]):
        if k == 0:  # a new line, 4 m away at a guess
            first = truth(0.0).pose()
            charts.append(rf.line_from_ruling(first * BODY_T_CAM, frames[0], 0.25))
            packet.values.insert(L(i), np.zeros(4))
            wide = noiseModel.Diagonal.Sigmas(np.array(rf.NEW_LINE_SIGMAS))
            packet.factors.add(rf.new_line_factor(wide, X(0), L(i), charts[i], first))
        points = rf.GeometricPoints.from_frames(frames)
        noise_model = noiseModel.Isotropic.Sigma(points.rows, 0.5 / FOCAL)
        keys = (X(k), V(k), B(k), L(i))
        packet.factors.add(
            rf.ruled_surface_factor(noise_model, *keys, motion, charts[i], points, BODY_T_CAM)
        )


def new_values(k: int, packet: Packet, estimate: gtsam.Values) -> gtsam.Values:
    """The packet's values, and state k as the IMU predicts it from the estimate of the last."""
    values = gtsam.Values(packet.values)
    if k > 0:
        bias = estimate.atConstantBias(B(k - 1))
        last = gtsam.NavState(estimate.atPose3(X(k - 1)), estimate.atVector(V(k - 1)))
        state = packet.imu.predict(last, bias)
        values.insert(X(k), state.pose())
        values.insert(V(k), state.velocity())
        values.insert(B(k), bias)
    return values


def levenberg_marquardt(packets: list[Packet]) -> gtsam.Values:
    """All states at once, from dead reckoning."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, packet in enumerate(packets):
        graph.push_back(packet.factors)
        values.insert(new_values(k, packet, values))
    params = rf.levenberg_marquardt_params()
    params.setRelativeErrorTol(1e-15)  # to the end, to compare with C++
    params.setAbsoluteErrorTol(1e-15)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()


def isam2(packets: list[Packet]) -> gtsam.Values:
    """State by state, keeping all of them."""
    solver = gtsam.ISAM2(rf.isam2_params())
    estimate = gtsam.Values()
    for k, packet in enumerate(packets):
        solver.update(packet.factors, new_values(k, packet, estimate))
        solver.update()
        estimate = solver.calculateEstimate()
    return estimate


SOLVERS: dict[str, Callable[[list[Packet]], gtsam.Values]] = {
    "Levenberg-Marquardt": levenberg_marquardt,
    "ISAM2": isam2,
}


def states(estimate: gtsam.Values) -> FloatArray:
    """Upper rows of the poses and velocities, (31, 15), as the C++ program writes them."""
    rows = [
        np.concatenate([estimate.atPose3(X(k)).matrix()[:3].ravel(), estimate.atVector(V(k))])
        for k in range(STATES)
    ]
    return np.array(rows)


def position_rmse(found: FloatArray) -> float:
    """Of all `states`, m."""
    positions = np.array([truth(state_time(k)).position() for k in range(STATES)])
    return float(np.sqrt(np.mean(np.sum((found[:, [3, 7, 11]] - positions) ** 2, axis=1))))


def run_program(program: Path) -> tuple[str, FloatArray]:
    """What the C++ program prints, and its `states` by each solver, (2, 31, 15)."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "states.txt"
        command = [program.resolve(), path]
        printed = subprocess.run(  # noqa: S603 - the caller's own program
            command, capture_output=True, text=True, check=True
        ).stdout
        return printed, np.loadtxt(path).reshape(len(SOLVERS), STATES, 15)


def main() -> None:
    """Print the table."""
    packets = build(simulate())
    found = []
    print(f"Python, {rf.active_kernel()} kernel")
    for name, solve in SOLVERS.items():
        seconds = []
        for _ in range(RUNS):
            start = time.process_time()
            estimate = solve(packets)
            seconds.append(time.process_time() - start)
        found.append(states(estimate))
        print(f"{name:20} {1e3 * position_rmse(found[-1]):8.3f} mm {min(seconds):8.3f} s")
    if len(sys.argv) > 1:
        runs = [run_program(Path(sys.argv[1])) for _ in range(RUNS)]
        print("C++")
        print(runs[0][0], end="")
        for name in SOLVERS:
            rows = [line for run in runs for line in run[0].splitlines() if line.startswith(name)]
            print(f"{name}: fastest {min(float(row.split()[-2]) for row in rows):.3f} s")
        for name, here, there in zip(SOLVERS, found, runs[0][1], strict=True):
            print(f"{name}: largest difference {np.abs(here - there).max():.1e}")


if __name__ == "__main__":
    main()
