# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated window: four lines, 140 frames at 90 Hz, a hand-held camera, a D435i-like IMU."""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X

from ruledgraph.calibration.imu_noise import D435I_LIKE, ImuNoise
from ruledgraph.simulation import SimulatedImu, SplineMotion, simulate_imu
from ruledgraph.simulation.edges import observe_segment
from ruledgraph_factors import (
    GeometricPoints,
    LineChart,
    line_from_ruling,
    preintegrate_frames,
    ruled_surface_factor,
)

FOCAL_LENGTH = 600.0
BODY_T_CAM = gtsam.Pose3(
    gtsam.Rot3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    np.array([0.02, 0.01, 0.005]),
)
# About two metres ahead along x: two upright lines and two that cross over in depth.
SEGMENTS = np.array(
    [
        [[2.2, -0.6, -0.5], [2.0, -0.6, 0.6]],
        [[2.0, 0.6, -0.5], [2.3, 0.5, 0.6]],
        [[2.1, -0.6, 0.55], [1.8, 0.6, 0.5]],
        [[1.7, -0.6, -0.5], [2.4, 0.6, -0.45]],
    ]
)
DURATION = 1.7


def hand_held(rng: np.random.Generator, reach: float = 0.25, turn: float = 0.25) -> SplineMotion:
    """Sines of 0.4 to 1.1 Hz on every axis, starting in motion at the origin."""
    times = np.linspace(0.0, DURATION, 9)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(2, 3))
    frequency = rng.uniform(0.4, 1.1, size=(2, 3))
    waves = np.sin(2.0 * np.pi * frequency[:, None] * times[:, None] + phase[:, None])
    waves -= waves[:, :1]
    return SplineMotion(times, reach * waves[0], turn * waves[1])


@dataclass
class Window:
    """Truth and measurements."""

    motion: SplineMotion
    imu: SimulatedImu
    times: np.ndarray
    edges: list[list[np.ndarray]]
    """Normalised points of each line in each frame."""


def simulate_window(
    rng: np.random.Generator,
    motion: SplineMotion | None = None,
    segments: np.ndarray = SEGMENTS,
    noise: ImuNoise | None = D435I_LIKE,
    pixel_noise: float = 0.5,
    points: int = 20,
    frames: int = 140,
    imu_bias: np.ndarray | None = None,
) -> Window:
    motion = hand_held(rng) if motion is None else motion
    imu = simulate_imu(motion, 400.0, noise, rng, imu_bias)
    times = np.arange(frames) / 90.0
    cameras = [motion.pose(time) * BODY_T_CAM for time in times]
    edges = [
        [observe_segment(c, ends, points, pixel_noise / FOCAL_LENGTH, rng) for c in cameras]
        for ends in segments
    ]
    return Window(motion, imu, times, edges)


@dataclass
class Problem:
    """A graph over the window, its initial and its true values."""

    graph: gtsam.NonlinearFactorGraph
    initial: gtsam.Values
    truth: gtsam.Values
    nodes: int


def smoothing_problem(
    rng: np.random.Generator,
    depth_factor: float = 1.0,
    frames_per_node: int = 9,
    pixel_noise: float = 0.5,
) -> Problem:
    """Priors drawn around the truth, one state each 0.1 s, lines guessed `depth_factor` too far."""
    bias_sigmas = np.repeat([0.05, 0.005], 3)
    window = simulate_window(
        rng, pixel_noise=pixel_noise, imu_bias=rng.normal(size=6) * bias_sigmas
    )
    start = window.motion.pose(0.0)
    pose_sigmas = np.full(6, 1e-3)
    pose = start.retract(rng.normal(size=6) * pose_sigmas)
    velocity = window.motion.velocity(0.0) + rng.normal(size=3) * 0.1
    bias = gtsam.imuBias.ConstantBias()

    graph, initial, truth = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.Values()
    graph.addPriorPose3(X(0), pose, noiseModel.Diagonal.Sigmas(pose_sigmas))
    graph.addPriorVector(V(0), velocity, noiseModel.Isotropic.Sigma(3, 0.1))
    graph.addPriorConstantBias(B(0), bias, noiseModel.Diagonal.Sigmas(bias_sigmas))

    charts = []
    wide = noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, 10.0, 10.0]))
    for i, (first, second) in enumerate(SEGMENTS):
        true_chart = LineChart.from_points(start * BODY_T_CAM, first, second)
        inverse_distance, _ = true_chart.inverse_distance(np.zeros(4))
        guess = inverse_distance / depth_factor
        charts.append(line_from_ruling(pose * BODY_T_CAM, window.edges[i][0], guess))
        graph.addPriorVector(L(i), np.zeros(4), wide)
        initial.insert(L(i), np.zeros(4))
        truth.insert(L(i), charts[i].local(np.cross(first, second - first), second - first))

    params = D435I_LIKE.preintegration_params()
    state = gtsam.NavState(pose, velocity)
    starts = range(0, len(window.times), frames_per_node)
    for k, first_frame in enumerate(starts):
        time = window.times[first_frame]
        initial.insert(X(k), state.pose())
        initial.insert(V(k), state.velocity())
        initial.insert(B(k), bias)
        truth.insert(X(k), window.motion.pose(time))
        truth.insert(V(k), window.motion.velocity(time))
        truth.insert(B(k), window.imu.bias_at(time))
        frames = slice(first_frame, first_frame + frames_per_node)
        motion = preintegrate_frames(window.imu.samples, time, window.times[frames], bias)
        for i, chart in enumerate(charts):
            points = GeometricPoints.from_frames(window.edges[i][frames])
            noise = noiseModel.Isotropic.Sigma(points.rows, pixel_noise / FOCAL_LENGTH)
            graph.add(
                ruled_surface_factor(
                    noise, X(k), V(k), B(k), L(i), motion, chart, points, BODY_T_CAM
                )
            )
        if first_frame + frames_per_node < len(window.times):
            end = window.times[first_frame + frames_per_node]
            preintegrated = gtsam.PreintegratedCombinedMeasurements(params, bias)
            used = window.times[frames]
            for segment in window.imu.samples.segments(time, end, at=used, bias=bias):
                preintegrated.integrateMeasurement(*segment)
            keys = (X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1))
            graph.add(gtsam.CombinedImuFactor(*keys, preintegrated))
            state = preintegrated.predict(state, bias)
    return Problem(graph, initial, truth, len(starts))


def optimize(problem: Problem) -> gtsam.Values:
    params = gtsam.LevenbergMarquardtParams()
    params.setDiagonalDamping(True)
    params.setlambdaUpperBound(1e10)
    return gtsam.LevenbergMarquardtOptimizer(problem.graph, problem.initial, params).optimize()
