# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in a fixed-lag smoother: how far may one move before it gets a new chart?

A hand-held camera sees four edges 3.4 to 4.8 m away for 3 s, three frames after a state every
0.1 s, 20 points of 0.5 px in each, beside an IMU like a D435i's. A line enters with all its
factors when `triangulate_line` has determined it, after 0.5 s at least. A smoother stops to
linearise a line anew when its first states leave the window. Where the estimate has moved on from
there by more than a threshold the line gets a new chart and key, tied to the old one by
`same_line_factor`.

Mean NEES per degree of freedom at the end, 1 is consistent: of each line, of the worst of the four,
of the pose; ties a run, and the runs that `check_lines` objects to.

    python tools/benchmarks/lag_lines.py [SEEDS]
"""

import sys
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X

import ruledgraph_factors as rf
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation import SplineMotion, simulate_imu
from ruledgraph.simulation.edges import observe_segment

STEP, STATES = 0.1, 31
OFFSETS = np.arange(3) / 30.0  # of the frames after a state, s
SIGMA = 0.5 / 600.0  # of a point, over the focal length
BODY_T_CAM = gtsam.Pose3(
    gtsam.Rot3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    np.array([0.02, 0.01, 0.005]),
)
SEGMENTS = np.array(
    [
        [[4.4, -1.2, -1.0], [4.0, -1.2, 1.2]],
        [[4.0, 1.2, -1.0], [4.6, 1.0, 1.2]],
        [[4.2, -1.2, 1.1], [3.6, 1.2, 1.0]],
        [[3.4, -1.2, -1.0], [4.8, 1.2, -0.9]],
    ]
)
NO_BIAS = gtsam.imuBias.ConstantBias()
BIAS_SIGMAS = np.repeat([0.05, 0.005], 3)  # m/s^2, rad/s
JOBS = 2  # processes
MIN_STATES = 5  # that have seen a line when it enters
MIN_TIE = 1e-4  # deviation of a tie, rad
NEVER = float("inf")
INCREMENTAL, BATCH = "incremental", "batch"
# Smoother, lag (s) and threshold (rad).
CASES = (
    *((INCREMENTAL, 0.6, threshold) for threshold in (NEVER, 0.1, 0.04)),
    *((INCREMENTAL, lag, threshold) for lag in (1.0, 1.5) for threshold in (NEVER, 0.04)),
    *((BATCH, 0.6, threshold) for threshold in (NEVER, 0.04)),
    (BATCH, 1.5, NEVER),
)


@dataclass
class Line:
    """What was seen of one, and where it stands in the graph."""

    frames: list[list[FloatArray]] = field(default_factory=list)
    """Of each state: points in the frames after it."""
    key: int = -1
    chart: rf.LineChart | None = None


class Outcome(NamedTuple):
    """Of one run; NEES by dimension."""

    lines: float
    worst: float
    pose: float
    ties: int
    objected: bool


class Run:
    """A simulated recording, and a smoother that follows it."""

    def __init__(self, seed: int, smoother: str, lag: float, threshold: float) -> None:
        self.rng = rng = np.random.default_rng(seed)
        times = np.linspace(0.0, STEP * (STATES + 1), 17)
        phase, frequency = rng.uniform(0.0, 2.0 * np.pi, (2, 3)), rng.uniform(0.4, 1.1, (2, 3))
        waves = np.sin(2.0 * np.pi * frequency[:, None] * times[:, None] + phase[:, None])
        waves -= waves[:, :1]
        self.motion = SplineMotion(times, 0.1 * waves[0], 0.1 * waves[1])
        bias = rng.normal(size=6) * BIAS_SIGMAS
        self.imu = simulate_imu(self.motion, 400.0, D435I_LIKE, rng, bias).samples
        self.threshold = threshold
        self.is_incremental = smoother == INCREMENTAL
        self.smoother: Any = (  # the stubs of the common base lack most of it
            gtsam.IncrementalFixedLagSmoother(lag, rf.isam2_params())
            if self.is_incremental
            else gtsam.BatchFixedLagSmoother(lag, rf.levenberg_marquardt_params())
        )
        self.lines = [Line() for _ in SEGMENTS]
        self.frame_motions: list[rf.FrameMotion] = []
        self.keys = self.ties = 0

    def follow(self) -> Outcome:
        """All states; the outcome at the last."""
        estimate = self.update(0, *self.first_state())
        for k in range(1, STATES):
            estimate = self.update(k, *self.next_state(k, estimate))
            graph, values = self.new_charts(estimate)
            if graph.size():
                estimate = self.update(k, graph, values)
        return self.outcome(estimate)

    def update(
        self, k: int, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values
    ) -> gtsam.Values:
        """The estimate with new factors and values; new keys and seen lines get the time of k."""
        lines = {line.key for line in self.lines} & set(graph.keyVector())
        times = dict.fromkeys((*values.keys(), *lines), k * STEP)
        self.smoother.update(graph, values, times)
        if self.is_incremental:
            self.smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), {})
        estimate: gtsam.Values = self.smoother.calculateEstimate()
        return estimate

    def first_state(self) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """With its priors."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        pose = self.motion.pose(0.0).retract(1e-3 * self.rng.normal(size=6))
        velocity = self.motion.velocity(0.0) + 0.05 * self.rng.normal(size=3)
        graph.addPriorPose3(X(0), pose, noiseModel.Isotropic.Sigma(6, 1e-3))
        graph.addPriorVector(V(0), velocity, noiseModel.Isotropic.Sigma(3, 0.05))
        graph.addPriorConstantBias(B(0), NO_BIAS, noiseModel.Diagonal.Sigmas(BIAS_SIGMAS))
        insert_state(values, 0, gtsam.NavState(pose, velocity), NO_BIAS)
        self.see(0)
        return graph, values

    def next_state(
        self, k: int, estimate: gtsam.Values
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """State k, the IMU from the one before, and the known lines in the frames after it."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        imu = gtsam.PreintegratedCombinedMeasurements(D435I_LIKE.preintegration_params(), NO_BIAS)
        start, stop = (k - 1) * STEP, k * STEP
        for segment in self.imu.segments(start, stop, at=start + OFFSETS, bias=NO_BIAS):
            imu.integrateMeasurement(*segment)
        keys = (X(k - 1), V(k - 1), X(k), V(k), B(k - 1), B(k))
        graph.add(gtsam.CombinedImuFactor(*keys, imu))
        state, bias = state_of(estimate, k - 1)
        insert_state(values, k, imu.predict(state, bias), bias)
        self.see(k)
        for line in self.lines:
            if line.chart is not None:
                graph.add(self.factor(line, line.chart, k))
        return graph, values

    def see(self, k: int) -> None:
        """The frames after state k."""
        times = k * STEP + OFFSETS
        self.frame_motions.append(rf.preintegrate_frames(self.imu, k * STEP, times, NO_BIAS))
        cameras = [self.motion.pose(time) * BODY_T_CAM for time in times]
        for line, ends in zip(self.lines, SEGMENTS, strict=True):
            line.frames.append([observe_segment(c, ends, 20, SIGMA, self.rng) for c in cameras])

    def factor(self, line: Line, chart: rf.LineChart, k: int) -> rf.RuledSurfaceFactor:
        """A line in the frames after state k."""
        points = rf.GeometricPoints.from_frames(line.frames[k])
        noise = noiseModel.Isotropic.Sigma(points.rows, SIGMA)
        keys = (X(k), V(k), B(k), line.key)
        return rf.ruled_surface_factor(
            noise, *keys, self.frame_motions[k], chart, points, BODY_T_CAM
        )

    def new_charts(self, estimate: gtsam.Values) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Of lines that enter, and of those that have moved too far."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for line in self.lines:
            if line.chart is None:
                self.enter(line, graph, values, estimate)
                continue
            delta = estimate.atVector(line.key)
            moved = delta - self.smoother.getLinearizationPoint().atVector(line.key)
            if np.linalg.norm(moved) <= self.threshold:
                continue
            noise = noiseModel.Isotropic.Sigma(4, max(0.5 * float(moved @ moved), MIN_TIE))
            old_key, old = line.key, line.chart
            line.chart, _ = old.recentred(delta)
            line.key = self.new_key(values)
            graph.add(rf.same_line_factor(noise, old_key, line.key, old, delta, line.chart))
            self.ties += 1
        return graph, values

    def enter(
        self,
        line: Line,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        estimate: gtsam.Values,
    ) -> None:
        """If its frames determine the line: with its prior and all factors."""
        states = [k for k in range(len(line.frames)) if estimate.exists(X(k))]
        if len(line.frames) < MIN_STATES:
            return
        poses = [self.frame_motions[k].poses(*state_of(estimate, k)) for k in states]
        cameras = [pose * BODY_T_CAM for after in poses for pose in after]
        points = [frame for k in states for frame in line.frames[k]]
        found = rf.triangulate_line(cameras, points, SIGMA)
        if not found.determined:
            return
        line.chart, line.key = found.chart, self.new_key(values)
        wide, first = noiseModel.Diagonal.Sigmas(rf.NEW_LINE_SIGMAS), X(states[0])
        pose = estimate.atPose3(first)
        graph.add(rf.new_line_factor(wide, first, line.key, found.chart, pose))
        for k in states:
            graph.add(self.factor(line, found.chart, k))

    def new_key(self, values: gtsam.Values) -> int:
        """Of a line that is its chart's reference."""
        key = L(self.keys)
        self.keys += 1
        values.insert(key, np.zeros(4))
        return key

    def outcome(self, estimate: gtsam.Values) -> Outcome:
        """Against the truth."""
        factors = self.smoother.getFactors()
        # The smoothers' graphs have the linear marginals, at the points they were linearised at.
        marginals = gtsam.Marginals(factors, self.smoother.getLinearizationPoint())
        squares = []
        for line, (first, second) in zip(self.lines, SEGMENTS, strict=True):
            if line.chart is None:
                continue
            along = second - first
            error = line.chart.local(np.cross(first, along), along) - estimate.atVector(line.key)
            squares.append(nees(error, marginals.marginalCovariance(line.key)))
        last = STATES - 1
        error = estimate.atPose3(X(last)).localCoordinates(self.motion.pose(last * STEP))
        pose = nees(error, marginals.marginalCovariance(X(last)))
        objected = not all(check.ok for check in rf.check_lines(factors, estimate))
        return Outcome(float(np.mean(squares)), max(squares), pose, self.ties, objected)


def insert_state(
    values: gtsam.Values, k: int, state: gtsam.NavState, bias: gtsam.imuBias.ConstantBias
) -> None:
    """Initial values of state k."""
    values.insert(X(k), state.pose())
    values.insert(V(k), state.velocity())
    values.insert(B(k), bias)


def state_of(estimate: gtsam.Values, k: int) -> tuple[gtsam.NavState, gtsam.imuBias.ConstantBias]:
    """State k."""
    state = gtsam.NavState(estimate.atPose3(X(k)), estimate.atVector(V(k)))
    return state, estimate.atConstantBias(B(k))


def nees(error: FloatArray, covariance: FloatArray) -> float:
    """By dimension."""
    return float(error @ np.linalg.solve(covariance, error)) / error.size


def main() -> None:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    print(f"{seeds} seeds. Mean NEES of lines, of the worst one and of the pose; ties a run")
    items = [(case, seed) for case in CASES for seed in range(seeds)]
    found = dict(in_parallel(lambda item: Run(item[1], *item[0]).follow(), items, workers=JOBS))
    for case in CASES:
        name, lag, threshold = case
        runs = [found[case, seed] for seed in range(seeds)]
        lines, worst, pose, ties, objected = np.mean(runs, axis=0)
        cells = f"{lines:8.2f}{worst:8.2f}{pose:8.2f}{ties:8.1f}"
        counted = f"objected to {objected * seeds:.0f} of {seeds}"
        print(f"{name:11} lag {lag:3} s  above {threshold:5g} rad{cells}   {counted}")


if __name__ == "__main__":
    main()
