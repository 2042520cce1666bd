# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Is the covariance of a graph with lines honest? Mean NEES per degree of freedom.

A hand-held camera sees four edges for 1.5 s, 90 frames a second, 20 points in each, beside an IMU
like a D435i's. Every line starts with `triangulate_line` at the dead-reckoned poses; a first
solution takes the edges to be as inaccurate as they look from there (its `rms`).

1 is consistent; the bounds are those of 95 % of such means. The lines of a seed share its first
pose's error, so they are taken together, with their joint covariance. With a state at every frame
the model is exact. With fewer a factor leaves out the noise of the IMU between a state and its
frames: above the bounds the graph is overconfident, and sharp edges want states at shorter
distances or `with_imu_noise`, which is cautious.

    python tools/benchmarks/line_nees.py [SEEDS]
"""

import sys
from collections.abc import Callable

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X
from scipy.stats import chi2

import ruledgraph_factors as rf
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation import SplineMotion, simulate_imu
from ruledgraph.simulation.edges import observe_segment
from ruledgraph_factors.spec import RuledSurfaceSpec

FOCAL = 600.0  # px
BODY_T_CAM = gtsam.Pose3(
    gtsam.Rot3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    np.array([0.02, 0.01, 0.005]),
)
SEGMENTS = np.array(
    [
        [[2.2, -0.6, -0.5], [2.0, -0.6, 0.6]],
        [[2.0, 0.6, -0.5], [2.3, 0.5, 0.6]],
        [[2.1, -0.6, 0.55], [1.8, 0.6, 0.5]],
        [[1.7, -0.6, -0.5], [2.4, 0.6, -0.45]],
    ]
)
FRAME_TIMES = np.arange(135) / 90.0
JOBS = 2  # processes
START_VIEWS = 45  # frames that a line is triangulated from
BIAS_SIGMAS = np.repeat([0.05, 0.005], 3)  # m/s^2, rad/s
NO_BIAS = gtsam.imuBias.ConstantBias()
DIMENSIONS = {"pose": 6, "velocity": 3, "bias": 6, "lines": 4 * len(SEGMENTS)}
# Noise of a point in pixels, frames from one state to the next, and `with_imu_noise`.
CASES = (
    *((pixels, step, False) for pixels, step in ((0.5, 3), (0.25, 3), (0.1, 1))),
    *((pixels, 9, imu_noise) for pixels in (0.5, 0.25, 0.1) for imu_noise in (False, True)),
)


def nees(seed: int, pixels: float, step: int, imu_noise: bool = False) -> tuple[FloatArray, bool]:
    """Of the last state and the lines, by dimension, and whether `check_lines` objects."""
    rng = np.random.default_rng(seed)
    nodes = np.linspace(0.0, 1.7, 9)
    phase, frequency = rng.uniform(0.0, 2.0 * np.pi, (2, 3)), rng.uniform(0.4, 1.1, (2, 3))
    waves = np.sin(2.0 * np.pi * frequency[:, None] * nodes[:, None] + phase[:, None])
    waves -= waves[:, :1]
    motion = SplineMotion(nodes, 0.25 * waves[0], 0.25 * waves[1])
    imu = simulate_imu(motion, 400.0, D435I_LIKE, rng, rng.normal(size=6) * BIAS_SIGMAS)
    sigma = pixels / FOCAL
    cameras = [motion.pose(time) * BODY_T_CAM for time in FRAME_TIMES]
    edges = [[observe_segment(c, ends, 20, sigma, rng) for c in cameras] for ends in SEGMENTS]
    pose = motion.pose(0.0).retract(1e-3 * rng.normal(size=6))
    velocity = motion.velocity(0.0) + 0.1 * rng.normal(size=3)

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.addPriorPose3(X(0), pose, noiseModel.Isotropic.Sigma(6, 1e-3))
    graph.addPriorVector(V(0), velocity, noiseModel.Isotropic.Sigma(3, 0.1))
    graph.addPriorConstantBias(B(0), NO_BIAS, noiseModel.Diagonal.Sigmas(BIAS_SIGMAS))
    state = gtsam.NavState(pose, velocity)
    start = rf.preintegrate_frames(imu.samples, 0.0, FRAME_TIMES[:START_VIEWS])
    poses = [p * BODY_T_CAM for p in start.poses(state, NO_BIAS)]
    charts, misfit = [], sigma
    wide = noiseModel.Diagonal.Sigmas(np.array(rf.NEW_LINE_SIGMAS))
    for i, seen in enumerate(edges):
        found = rf.triangulate_line(poses, seen[:START_VIEWS], sigma)
        charts.append(found.chart)
        misfit = max(misfit, found.rms)
        graph.add(rf.new_line_factor(wide, X(0), L(i), charts[i], pose))
        values.insert(L(i), np.zeros(4))
    params = D435I_LIKE.preintegration_params()
    starts = range(0, FRAME_TIMES.size, step)
    for k, first in enumerate(starts):
        time = FRAME_TIMES[first]
        values.insert(X(k), state.pose())
        values.insert(V(k), state.velocity())
        values.insert(B(k), NO_BIAS)
        frames = slice(first, first + step)
        frame_motion = rf.preintegrate_frames(imu.samples, time, FRAME_TIMES[frames])
        for i, chart in enumerate(charts):
            points = rf.GeometricPoints.from_frames(edges[i][frames])
            noise = noiseModel.Isotropic.Sigma(points.rows, sigma)
            keys = (X(k), V(k), B(k), L(i))
            graph.add(
                rf.ruled_surface_factor(noise, *keys, frame_motion, chart, points, BODY_T_CAM)
            )
        if k + 1 < len(starts):
            stop = FRAME_TIMES[first + step]
            preintegrated = gtsam.PreintegratedCombinedMeasurements(params, NO_BIAS)
            for segment in imu.samples.segments(time, stop, at=FRAME_TIMES[frames], bias=NO_BIAS):
                preintegrated.integrateMeasurement(*segment)
            imu_keys = (X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1))
            graph.add(gtsam.CombinedImuFactor(*imu_keys, preintegrated))
            state = preintegrated.predict(state, NO_BIAS)
    rough = with_lines(graph, lambda factor: with_sigma(factor, misfit))
    values = optimize(graph, optimize(rough, values))
    if imu_noise:
        estimate = values
        graph = with_lines(graph, lambda factor: with_imu_noise(factor, estimate))
        values = optimize(graph, values)
    objected = not all(check.ok for check in rf.check_lines(graph, values))
    marginals = gtsam.Marginals(graph, values)
    last, end = len(starts) - 1, FRAME_TIMES[starts[-1]]
    errors = {
        X(last): values.atPose3(X(last)).localCoordinates(motion.pose(end)),
        V(last): motion.velocity(end) - values.atVector(V(last)),
        B(last): imu.bias_at(end).vector() - values.atConstantBias(B(last)).vector(),
    }
    squares = [
        float(error @ np.linalg.solve(marginals.marginalCovariance(key), error))
        for key, error in errors.items()
    ]
    squares.append(squared_line_errors(charts, values, marginals))
    return np.array(squares) / np.array(list(DIMENSIONS.values())), objected


def squared_line_errors(
    charts: list[rf.LineChart], values: gtsam.Values, marginals: gtsam.Marginals
) -> float:
    """Squared errors of all lines together, whitened by their joint covariance."""
    keys = [L(i) for i in range(len(charts))]
    whole = marginals.jointMarginalCovariance(keys)
    errors, by_delta = [], []
    for key, old, (first_end, second_end) in zip(keys, charts, SEGMENTS, strict=True):
        along = second_end - first_end
        chart, jacobian = old.recentred(values.atVector(key))
        errors.append(chart.local(np.cross(first_end, along), along))
        by_delta.append(jacobian)
    covariance = np.block(
        [
            [by_delta[i] @ whole.at(a, b) @ by_delta[j].T for j, b in enumerate(keys)]
            for i, a in enumerate(keys)
        ]
    )
    error = np.concatenate(errors)
    return float(error @ np.linalg.solve(covariance, error))


def optimize(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Values:
    """Levenberg-Marquardt."""
    params = rf.levenberg_marquardt_params()
    return gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()


def with_lines(
    graph: gtsam.NonlinearFactorGraph,
    change: Callable[[rf.RuledSurfaceFactor], rf.RuledSurfaceFactor],
) -> gtsam.NonlinearFactorGraph:
    """The same graph with other line factors."""
    changed = gtsam.NonlinearFactorGraph()
    for index in range(graph.size()):
        factor = graph.at(index)
        spec = rf.spec_of(factor)
        if isinstance(spec, RuledSurfaceSpec):
            factor = change(rf.RuledSurfaceFactor(spec))
        changed.add(factor)
    return changed


def with_sigma(factor: rf.RuledSurfaceFactor, sigma: float) -> rf.RuledSurfaceFactor:
    """Points of another standard deviation."""
    spec = factor.spec
    return rf.RuledSurfaceFactor(spec.with_noise(noiseModel.Isotropic.Sigma(spec.rows, sigma)))


def with_imu_noise(factor: rf.RuledSurfaceFactor, values: gtsam.Values) -> rf.RuledSurfaceFactor:
    """With the noise of the IMU between states and frames."""
    noise = D435I_LIKE
    return rf.with_imu_noise(
        factor, values, noise.accelerometer, noise.gyroscope, lines=len(SEGMENTS)
    )


def main() -> None:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print(f"{seeds} seeds. 95 % bounds:")
    for name, dimension in DIMENSIONS.items():
        low, high = chi2.ppf([0.025, 0.975], dimension * seeds) / (dimension * seeds)
        print(f"  {name:9} {low:.2f} to {high:.2f}")
    names = "".join(f"{name:>10}" for name in DIMENSIONS)
    print(f"noise (px)  frames a state  IMU noise  {names}  objected")
    items = [(case, seed) for case in CASES for seed in range(seeds)]
    found = dict(in_parallel(lambda item: nees(item[1], *item[0]), items, workers=JOBS))
    for case in CASES:
        pixels, step, imu_noise = case
        runs = [found[case, seed] for seed in range(seeds)]
        cells = "".join(f"{value:10.2f}" for value in np.mean([run[0] for run in runs], axis=0))
        objected = sum(run[1] for run in runs)
        print(f"{pixels:10} {step:15} {imu_noise!s:>10}  {cells}{objected:10}")


if __name__ == "__main__":
    main()
