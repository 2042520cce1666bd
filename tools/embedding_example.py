# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in your own GTSAM graph: `ruledgraph_factors` beside native factors, under your own keys.

The graph is an ordinary visual-inertial one: pose, velocity and bias every 0.1 s (a state), IMU
factors between them, projections of a few points. `add_lines` is all it takes to add lines to it.
It is then solved three ways, without and with them, and compared with the simulated truth:

    python tools/embedding_example.py
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import E, P, Q, S, U  # line, pose, point, velocity, bias: any keys do

from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation import SplineMotion, simulate_imu
from ruledgraph.simulation.edges import observe_segment
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    GeometricPoints,
    ImuSamples,
    LineChart,
    isam2_params,
    levenberg_marquardt_params,
    line_from_ruling,
    new_line_factor,
    preintegrate_frames,
    ruled_surface_factor,
)

SEEDS = range(5)
STATE_TIMES = 0.1 * np.arange(31)
FRAME_OFFSETS = np.arange(3) / 30.0  # of the 30 Hz camera's frames, from each state on, s
IMU_RATE = 200.0
LAG = 1.5  # s
BODY_T_CAM = gtsam.Pose3(  # the camera looks along the body's x axis; the body's z axis points up
    gtsam.Rot3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    np.array([0.05, 0.02, -0.01]),
)
FOCAL = 425.0  # px
CALIBRATION = gtsam.Cal3_S2(FOCAL, FOCAL, 0.0, 424.0, 240.0)
POINT_NOISE, EDGE_NOISE = 1.0, 0.5  # px
LINE_DISTANCE = 5.5  # m, the guess for every new line; really they are 2.5 to 4.5 m away
NO_BIAS = gtsam.imuBias.ConstantBias()
IMU_PARAMS = D435I_LIKE.preintegration_params()
ISAM_PARAMS = isam2_params()

FIRST_POSE = noiseModel.Isotropic.Sigma(6, 1e-4)  # the gauge
FIRST_VELOCITY = noiseModel.Isotropic.Sigma(3, 0.05)  # m/s
FIRST_BIAS = noiseModel.Diagonal.Sigmas(np.array([0.02] * 3 + [0.001] * 3))  # m/s^2, rad/s
NEW_POINT = noiseModel.Isotropic.Sigma(3, 1.0)  # until a second view shows its depth
PROJECTION = noiseModel.Isotropic.Sigma(2, POINT_NOISE)
NEW_LINE = noiseModel.Diagonal.Sigmas(NEW_LINE_SIGMAS)


@dataclass
class Recording:
    """What the sensors saw, where the estimators start, and the truth."""

    truth: list[gtsam.Pose3]
    """world_T_body of the states."""
    start: gtsam.NavState
    """Initial value of the first state."""
    imu: ImuSamples
    pixels: FloatArray
    """Of all points at all states, (states, points, 2)."""
    points: FloatArray
    """Initial values, (points, 3): the truth plus noise of 15 cm."""
    edges: list[dict[int, list[FloatArray]]]
    """For each state: line -> its edge points, normalised, in each frame up to the next state."""


@dataclass
class Packet:
    """What one state adds to the graph."""

    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    """Initial values of new points and lines, and of the first state."""
    imu: gtsam.PreintegratedCombinedMeasurements
    """From the state before; empty at the first."""


def simulate(seed: int) -> Recording:
    """A hand-held walk along a wall with points and edges.

    The edges are at most 27 degrees off the wall's plane. A new line starts perpendicular to its
    viewing ray; edges that recede by more than 45 degrees want `triangulate_line` instead, once
    they were seen from two positions.
    """
    rng = np.random.default_rng(seed)
    waypoints = np.arange(-0.5, 4.1, 0.5)
    walk = np.outer(waypoints, [0.0, 0.4, 0.0]) + rng.normal(scale=0.1, size=(waypoints.size, 3))
    motion = SplineMotion(waypoints, walk, rng.normal(scale=0.08, size=walk.shape))
    bias = rng.normal(size=6) * FIRST_BIAS.sigmas()
    imu = simulate_imu(motion, IMU_RATE, D435I_LIKE, rng, initial_bias=bias).samples
    velocity = motion.velocity(0.0) + rng.normal(scale=0.05, size=3)

    truth = [motion.pose(time) for time in STATE_TIMES]
    cameras = [gtsam.PinholeCameraCal3_S2(pose * BODY_T_CAM, CALIBRATION) for pose in truth]
    points = rng.uniform([3.5, -0.5, -0.8], [5.0, 1.7, 0.8], size=(5, 3))
    pixels = np.array([[camera.project(point) for point in points] for camera in cameras])

    middles = rng.uniform([2.5, -1.8, -1.0], [4.5, 3.0, 1.0], size=(8, 3))
    slope, angle = rng.uniform(-0.5, 0.5, size=8), rng.uniform(0.0, np.pi, size=8)
    halves = 0.5 * np.column_stack([slope, np.cos(angle), np.sin(angle)])
    segments = np.stack([middles - halves, middles + halves], axis=1)
    edges, new_line = [], itertools.count()
    lines: dict[int, int] = {}  # of the segments in view; one that was lost comes back as another
    for time in STATE_TIMES[:-1]:
        frames = [motion.pose(time + offset) * BODY_T_CAM for offset in FRAME_OFFSETS]
        seen = [i for i, ends in enumerate(segments) if in_view(frames, ends)]
        lines = {i: lines[i] if i in lines else next(new_line) for i in seen}
        edges.append(
            {
                line: [observe_segment(f, segments[i], 20, EDGE_NOISE / FOCAL, rng) for f in frames]
                for i, line in lines.items()
            }
        )
    return Recording(
        truth=truth,
        start=gtsam.NavState(truth[0], velocity),
        imu=imu,
        pixels=pixels + rng.normal(scale=POINT_NOISE, size=pixels.shape),
        points=points + rng.normal(scale=0.15, size=points.shape),
        edges=edges,
    )


def in_view(cameras: list[gtsam.Pose3], points: FloatArray) -> bool:
    """Whether all points are in all images."""
    rays = np.array([camera.transformTo(point) for camera in cameras for point in points])
    return bool(np.all(np.abs(rays[:, :2]) < rays[:, 2:] * [0.99, 0.56]))


def build(recording: Recording, with_lines: bool) -> list[Packet]:
    """The graph, state by state."""
    packets = []
    charts: dict[int, LineChart] = {}
    state = recording.start
    for k in range(STATE_TIMES.size):
        imu = gtsam.PreintegratedCombinedMeasurements(IMU_PARAMS, NO_BIAS)
        packet = Packet(gtsam.NonlinearFactorGraph(), gtsam.Values(), imu)
        packets.append(packet)
        if k == 0:
            add_first_state(packet, recording)
        else:
            # What `preintegrate_frames` integrates, too: states and frames see the same motion.
            start, stop = STATE_TIMES[k - 1 : k + 1]
            frames = start + FRAME_OFFSETS
            for segment in recording.imu.segments(start, stop, at=frames, bias=NO_BIAS):
                imu.integrateMeasurement(*segment)
            packet.factors.add(
                gtsam.CombinedImuFactor(P(k - 1), S(k - 1), P(k), S(k), U(k - 1), U(k), imu)
            )
            if with_lines:
                add_lines(packet, recording, k - 1, charts, state.pose())
            state = imu.predict(state, NO_BIAS)
        for j, pixel in enumerate(recording.pixels[k]):
            packet.factors.add(
                gtsam.GenericProjectionFactorCal3_S2(
                    pixel, PROJECTION, P(k), Q(j), CALIBRATION, BODY_T_CAM
                )
            )
    return packets


def add_first_state(packet: Packet, recording: Recording) -> None:
    """Initial values and priors of the first state and of the points."""
    pose, velocity = recording.start.pose(), recording.start.velocity()
    packet.values.insert(P(0), pose)
    packet.values.insert(S(0), velocity)
    packet.values.insert(U(0), NO_BIAS)
    packet.factors.addPriorPose3(P(0), pose, FIRST_POSE)
    packet.factors.addPriorVector(S(0), velocity, FIRST_VELOCITY)
    packet.factors.addPriorConstantBias(U(0), NO_BIAS, FIRST_BIAS)
    for j, point in enumerate(recording.points):
        packet.values.insert(Q(j), point)
        packet.factors.addPriorPoint3(Q(j), point, NEW_POINT)


def add_lines(
    packet: Packet,
    recording: Recording,
    k: int,
    charts: dict[int, LineChart],
    world_T_body: gtsam.Pose3,
) -> None:
    """The embedding: one factor for each line seen in the frames from state k up to the next.

    A line is a Vector4 in a chart, a constant anchored at the camera that saw the line first:
    `world_T_body` is the estimate of state k at that time (here dead reckoning will do).
    """
    # All of it, from here ...
    frame_times = STATE_TIMES[k] + FRAME_OFFSETS
    motion = preintegrate_frames(recording.imu, STATE_TIMES[k], frame_times, NO_BIAS)
    for i, frames in recording.edges[k].items():
        if i not in charts:  # a new line
            world_T_cam = world_T_body * BODY_T_CAM
            charts[i] = line_from_ruling(world_T_cam, frames[0], 1.0 / LINE_DISTANCE)
            packet.values.insert(E(i), np.zeros(4))
            packet.factors.add(new_line_factor(NEW_LINE, P(k), E(i), charts[i], world_T_body))
        points = GeometricPoints.from_frames(frames)
        noise = noiseModel.Isotropic.Sigma(points.rows, EDGE_NOISE / FOCAL)
        packet.factors.add(
            ruled_surface_factor(
                noise, P(k), S(k), U(k), E(i), motion, charts[i], points, BODY_T_CAM
            )
        )
    # ... to here.


def new_values(k: int, packet: Packet, estimate: gtsam.Values) -> gtsam.Values:
    """The packet's values, and state k as the IMU predicts it from the estimate of the last."""
    values = gtsam.Values(packet.values)
    if k > 0:
        bias = estimate.atConstantBias(U(k - 1))
        last = gtsam.NavState(estimate.atPose3(P(k - 1)), estimate.atVector(S(k - 1)))
        state = packet.imu.predict(last, bias)
        values.insert(P(k), state.pose())
        values.insert(S(k), state.velocity())
        values.insert(U(k), bias)
    return values


def levenberg_marquardt(packets: list[Packet]) -> list[gtsam.Pose3]:
    """All states at once, from dead reckoning."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, packet in enumerate(packets):
        graph.push_back(packet.factors)
        values.insert(new_values(k, packet, values))
    params = levenberg_marquardt_params()
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    return [values.atPose3(P(k)) for k in range(len(packets))]


def isam2(packets: list[Packet]) -> list[gtsam.Pose3]:
    """State by state, keeping all of them."""
    solver = gtsam.ISAM2(ISAM_PARAMS)
    estimate = gtsam.Values()
    for k, packet in enumerate(packets):
        solver.update(packet.factors, new_values(k, packet, estimate))
        solver.update()
        estimate = solver.calculateEstimate()
    return [estimate.atPose3(P(k)) for k in range(len(packets))]


def fixed_lag(packets: list[Packet]) -> list[gtsam.Pose3]:
    """State by state, keeping those within the lag; every pose as estimated when it was added."""
    smoother = gtsam.IncrementalFixedLagSmoother(LAG, ISAM_PARAMS)
    estimate, poses = gtsam.Values(), []
    for k, packet in enumerate(packets):
        # Points and lines get a new time whenever they are seen, and so outlive the states they
        # began at. What has left the lag is gone: a line seen again after that is a new one.
        times = dict.fromkeys(packet.factors.keyVector(), STATE_TIMES[k])
        smoother.update(packet.factors, new_values(k, packet, estimate), times)
        smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), {})
        estimate = smoother.calculateEstimate()
        poses.append(estimate.atPose3(P(k)))
    return poses


SOLVERS = {"Levenberg-Marquardt": levenberg_marquardt, "ISAM2": isam2, "fixed lag": fixed_lag}


def rms_errors(poses: list[gtsam.Pose3], truth: list[gtsam.Pose3]) -> FloatArray:
    """Of position (mm) and rotation (mdeg) over all states, (2,)."""
    gaps = [true.between(pose) for true, pose in zip(truth, poses, strict=True)]
    errors = np.array([[gap.translation(), gtsam.Rot3.Logmap(gap.rotation())] for gap in gaps])
    return np.asarray(np.sqrt(np.sum(errors**2, axis=2).mean(axis=0)) * [1e3, np.degrees(1e3)])


def run(seeds: Sequence[int]) -> dict[str, FloatArray]:
    """For each solver, mean over the seeds: (without, with lines) x (position, rotation)."""
    errors: dict[str, list[list[FloatArray]]] = {name: [] for name in SOLVERS}
    for seed in seeds:
        recording = simulate(seed)
        graphs = [build(recording, with_lines) for with_lines in (False, True)]
        for name, solve in SOLVERS.items():
            errors[name].append([rms_errors(solve(graph), recording.truth) for graph in graphs])
    return {name: np.mean(e, axis=0) for name, e in errors.items()}


def main() -> None:
    """Print the table."""
    print(f"""
Simulated walk of 3 s, IMU of a D435i at 200 Hz, a state every 0.1 s.
Points: 5, with {POINT_NOISE} px of noise, seen at states only; initial values 15 cm off.
Lines: up to 8 in view, 20 edge points with {EDGE_NOISE} px of noise in each 30 Hz frame; at most
27 degrees off the plane of a wall, 2.5 to 4.5 m in front; a new line starts {LINE_DISTANCE} m away.
RMSE over all states, mean of {len(SEEDS)} seeds. Levenberg-Marquardt and ISAM2: final estimate.
Fixed-lag smoother ({LAG} s): live estimate, that of each state when it was added.

                        position (mm)          rotation (mdeg)
                     no lines   + lines      no lines   + lines""")
    for name, (without, with_lines) in run(SEEDS).items():
        cells = "   ".join(f"{a:10.1f}{b:10.1f}" for a, b in zip(without, with_lines, strict=True))
        print(f"{name:19}{cells}")


if __name__ == "__main__":
    main()
