# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines added to GTSAM's own examples: position error without and with them.

The scenes are those of GTSAM's `CombinedImuFactorExample` (a body on a constant twist, a state a
second, priors on the first and the last, here drawn from their noise; LM) and `VisualISAM2Example`
(a cube's corners seen from a circle of poses; ISAM2). Without lines they are solved as there. With
lines, every line starts with `triangulate_line` at the poses estimated without it, and
`check_lines` has the last word:

    python tools/benchmarks/foreign_graphs.py [SEEDS]
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, P, V, X

import ruledgraph_factors as rf
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.arrays import FloatArray

WIDE = noiseModel.Diagonal.Sigmas(np.array(rf.NEW_LINE_SIGMAS))
TWISTS = {  # rotation, rad/s, and velocity, m/s, in the body
    "forward twist": (np.zeros(3), np.array([2.0, 0.0, 0.0])),
    "sick twist": (np.radians([30.0, -30.0, 0.0]), np.array([2.0, 0.0, 0.0])),
}
IMU_SIGMA, IMU_STEP = 1e-3, 0.01
BIAS = gtsam.imuBias.ConstantBias(np.array([-0.3, 0.1, 0.2]), np.array([0.1, 0.3, -0.1]))
PRIOR = 0.02  # of pose (rad, m) and velocity (m/s); the means are drawn from it
EDGE_SIGMA = 1e-3  # half a pixel at a focal length of 500 px
FRAMES = np.arange(5) / 5.0  # after each state, s
NOISE_SCALES = (30.0, 5.0)  # of the solutions on the way from a poor estimate
SECONDS = 12
BODY_T_CAM = gtsam.Pose3(  # looks to the left of the way
    gtsam.Rot3(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])), np.zeros(3)
)


@dataclass
class Line:
    """The interval factors' measurements of one line, and where it stands in the graph."""

    observed: dict[int, tuple[list[int], list[FloatArray]]]
    """State -> frames after it, points in each."""
    key: int = -1
    chart: rf.LineChart | None = None


def twist(name: str, seed: int) -> tuple[float, float]:
    """Position RMSE (m) of all states, without and with lines."""
    rng = np.random.default_rng(seed)
    scenario = gtsam.ConstantTwistScenario(*TWISTS[name])
    params = imu_params()
    runner = gtsam.ScenarioRunner(scenario, params, IMU_STEP, BIAS)
    times = np.arange(0.0, SECONDS + IMU_STEP, IMU_STEP)
    noise = rng.normal(scale=IMU_SIGMA / np.sqrt(IMU_STEP), size=(2, times.size, 3))
    rate = [runner.actualAngularVelocity(t) + BIAS.gyroscope() for t in times]
    force = [runner.actualSpecificForce(t) + BIAS.accelerometer() for t in times]
    imu = rf.ImuSamples(times, rate + noise[0], force + noise[1])

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i in (0, SECONDS):
        state = scenario.navState(i)
        pose = state.pose().retract(PRIOR * rng.normal(size=6))
        velocity = state.velocity() + PRIOR * rng.normal(size=3)
        graph.addPriorPose3(X(i), pose, noiseModel.Isotropic.Sigma(6, PRIOR))
        graph.addPriorVector(V(i), velocity, noiseModel.Isotropic.Sigma(3, PRIOR))
        graph.addPriorConstantBias(B(i), BIAS, noiseModel.Isotropic.Sigma(6, 0.001))
    for i in range(SECONDS + 1):
        state = scenario.navState(i)
        values.insert(X(i), state.pose().retract(rng.normal(size=6) * 0.1))
        values.insert(V(i), state.velocity() + rng.normal(size=3) * 0.1)
        values.insert(B(i), BIAS)
    motions = []
    for i in range(SECONDS):
        preintegrated = gtsam.PreintegratedCombinedMeasurements(params, BIAS)
        for segment in imu.segments(i, i + 1, at=i + FRAMES, bias=BIAS):
            preintegrated.integrateMeasurement(*segment)
        keys = (X(i), V(i), X(i + 1), V(i + 1), B(i), B(i + 1))
        graph.add(gtsam.CombinedImuFactor(*keys, preintegrated))
        motions.append(rf.preintegrate_frames(imu, i, i + FRAMES, BIAS))
    without = optimize(graph, values)
    cameras = [[scenario.pose(i + t) * BODY_T_CAM for t in FRAMES] for i in range(SECONDS)]
    lines = observe(cameras, rng)
    with_lines = solve_with_lines(graph, without, lines, motions)

    def rmse(solved: gtsam.Values) -> float:
        true = [scenario.pose(i).translation() for i in range(SECONDS + 1)]
        gaps = [solved.atPose3(X(i)).translation() - place for i, place in enumerate(true)]
        return float(np.sqrt(np.mean(np.sum(np.square(gaps), axis=1))))

    return rmse(without), rmse(with_lines)


def imu_params() -> gtsam.PreintegrationCombinedParams:
    """Those of the example."""
    params = gtsam.PreintegrationCombinedParams.MakeSharedU(9.81)
    params.setGyroscopeCovariance(IMU_SIGMA**2 * np.eye(3))
    params.setAccelerometerCovariance(IMU_SIGMA**2 * np.eye(3))
    params.setIntegrationCovariance(1e-14 * np.eye(3))
    return params


def observe(cameras: list[list[gtsam.Pose3]], rng: np.random.Generator) -> list[Line]:
    """Random edges, 2 to 6 m beside the way, by state and frame in which both ends are in view."""
    lines = []
    for poses in cameras:
        for _ in range(4):
            middle = rng.uniform([-2.0, -1.5, 2.0], [2.0, 1.5, 6.0])
            half = rng.normal(size=3)
            half *= 0.7 / np.linalg.norm(half)
            ends = [poses[2].transformFrom(middle + sign * half) for sign in (-1.0, 1.0)]
            line = Line({})
            for i, interval in enumerate(cameras):
                seen = [points_of(camera, ends, rng) for camera in interval]
                found = {j: points for j, points in enumerate(seen) if points is not None}
                if found:
                    line.observed[i] = list(found), list(found.values())
            lines.append(line)
    return lines


def points_of(
    camera: gtsam.Pose3, ends: list[FloatArray], rng: np.random.Generator
) -> FloatArray | None:
    """20 edge points, None if an end is out of view."""
    inside = np.array([camera.transformTo(end) for end in ends])
    if np.any(inside[:, 2] < 0.3) or np.any(np.abs(inside[:, :2]) > 0.8 * inside[:, 2:]):
        return None
    image = inside[:, :2] / inside[:, 2:]
    along = rng.uniform(size=(20, 1))
    noise = rng.normal(scale=EDGE_SIGMA, size=(20, 2))
    return np.asarray(image[0] + along * (image[1] - image[0]) + noise)


def solve_with_lines(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    lines: list[Line],
    motions: list[rf.FrameMotion],
) -> gtsam.Values:
    """Lines start from the estimate without them. Where that is poor they draw it to a better one
    with their noise taken too large at first; then all of them start again. Those that end in a
    wrong minimum stay out. If those are most of them, it is the estimate that is wrong: no lines.
    """
    without = values
    for scale in NOISE_SCALES:
        for number, line in enumerate(lines):
            start(number, line, values, motions)
        values = optimize(*assemble(graph, values, lines, motions, scale))
    full, values = assemble(graph, values, lines, motions)
    values = optimize(full, values)
    bad = {check.key for check in rf.check_lines(full, values) if not check.ok}
    if 2 * len(bad) > sum(line.key >= 0 for line in lines):
        return without
    for line in lines:
        if line.key in bad:
            line.key = -1
    return optimize(*assemble(graph, values, lines, motions))


def start(number: int, line: Line, values: gtsam.Values, motions: list[rf.FrameMotion]) -> None:
    """Triangulate the line from the states' estimates."""
    cameras, points = [], []
    for i, (frames, seen) in line.observed.items():
        state = gtsam.NavState(values.atPose3(X(i)), values.atVector(V(i)))
        poses = motions[i].select(frames).poses(state, values.atConstantBias(B(i)))
        cameras += [pose * BODY_T_CAM for pose in poses]
        points += seen
    if len(cameras) >= 2:
        found = rf.triangulate_line(cameras, points, EDGE_SIGMA)
        line.key, line.chart = L(number) if found.determined else -1, found.chart
        if values.exists(L(number)):
            values.erase(L(number))


def assemble(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    lines: list[Line],
    motions: list[rf.FrameMotion],
    scale: float = 1.0,
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The graph with the lines that have started, their noise `scale` times what it is."""
    graph, values = gtsam.NonlinearFactorGraph(graph), gtsam.Values(values)
    for number, line in enumerate(lines):
        if line.key < 0 or line.chart is None:
            if values.exists(L(number)):
                values.erase(L(number))
            continue
        if not values.exists(line.key):
            values.insert(line.key, np.zeros(4))
        first = min(line.observed)
        pose = values.atPose3(X(first))
        graph.add(rf.new_line_factor(WIDE, X(first), line.key, line.chart, pose))
        for i, (frames, seen) in line.observed.items():
            points = rf.GeometricPoints.from_frames(seen)
            noise = noiseModel.Isotropic.Sigma(points.rows, scale * EDGE_SIGMA)
            keys, motion = (X(i), V(i), B(i), line.key), motions[i].select(frames)
            graph.add(rf.ruled_surface_factor(noise, *keys, motion, line.chart, points, BODY_T_CAM))
    return graph, values


def optimize(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Values:
    """Levenberg-Marquardt."""
    params = rf.levenberg_marquardt_params()
    return gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()


CUBE = np.array([[x, y, z] for x in (-10.0, 10.0) for y in (-10.0, 10.0) for z in (-10.0, 10.0)])
EDGES = [(i, j) for i in range(8) for j in range(i) if np.sum(CUBE[i] != CUBE[j]) == 1]
CALIBRATION = gtsam.Cal3_S2(50.0, 50.0, 0.0, 50.0, 50.0)
PIXEL = 1.0 / 50.0  # of one pixel, in normalised image units
START_ERROR = gtsam.Pose3(gtsam.Rot3.Rodrigues(-0.1, 0.2, 0.25), np.array([0.05, -0.1, 0.2]))


@dataclass
class Cube:
    """ISAM2 over the cube, view by view."""

    rng: np.random.Generator
    with_lines: bool
    solver: gtsam.ISAM2 = field(default_factory=lambda: gtsam.ISAM2(rf.isam2_params()))
    seen: dict[int, list[tuple[int, FloatArray]]] = field(default_factory=dict)
    """Edge -> view and points of each view that is not in the graph yet."""
    charts: dict[int, rf.LineChart] = field(default_factory=dict)

    def run(self) -> float:
        """Position RMSE of all poses, m."""
        angles = 2.0 * np.pi * np.arange(8) / 8.0
        truth = [
            gtsam.PinholeCameraCal3_S2.Lookat(
                np.array([30.0 * np.cos(a), 30.0 * np.sin(a), 10.0]),
                np.zeros(3),
                np.array([0.0, 0.0, 1.0]),
                CALIBRATION,
            )
            for a in angles
        ]
        estimate = gtsam.Values()
        for k, camera in enumerate(truth):
            graph, values = self.view(k, camera)
            if k == 0:
                sigmas = np.array([0.1] * 3 + [0.3] * 3)
                graph.addPriorPose3(X(0), camera.pose(), noiseModel.Diagonal.Sigmas(sigmas))
                graph.addPriorPoint3(P(0), CUBE[0], noiseModel.Isotropic.Sigma(3, 0.1))
                for j, corner in enumerate(CUBE):
                    values.insert(P(j), corner + np.array([-0.25, 0.20, 0.15]))
                self.waiting = graph, values  # one view alone determines nothing
                continue
            if k == 1:
                graph.push_back(self.waiting[0])
                values.insert(self.waiting[1])
            self.solver.update(graph, values)
            self.solver.update()
            estimate = self.solver.calculateEstimate()
            if self.with_lines:
                self.solver.update(*self.new_lines(estimate))
                for _ in range(2):
                    self.solver.update()
                estimate = self.solver.calculateEstimate()
        gaps = [
            estimate.atPose3(X(k)).translation() - c.pose().translation()
            for k, c in enumerate(truth)
        ]
        return float(np.sqrt(np.mean(np.sum(np.square(gaps), axis=1))))

    def view(
        self, k: int, camera: gtsam.PinholeCameraCal3_S2
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """What a new view adds."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(X(k), camera.pose() * START_ERROR)
        pixel = noiseModel.Isotropic.Sigma(2, 1.0)
        for j, corner in enumerate(CUBE):
            measured = camera.project(corner) + self.rng.normal(size=2)
            graph.add(
                gtsam.GenericProjectionFactorCal3_S2(measured, pixel, X(k), P(j), CALIBRATION)
            )
        for edge, (i, j) in enumerate(EDGES):
            inside = np.array([camera.pose().transformTo(CUBE[n]) for n in (i, j)])
            image = inside[:, :2] / inside[:, 2:]
            along = np.linspace(0.0, 1.0, 20)[:, None]
            points = image[0] + along * (image[1] - image[0])
            points = points + self.rng.normal(scale=PIXEL, size=points.shape)
            if edge in self.charts:
                if self.with_lines:
                    graph.add(self.factor(edge, k, points))
            else:
                self.seen.setdefault(edge, []).append((k, points))
        return graph, values

    def new_lines(self, estimate: gtsam.Values) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """Lines that the views so far determine."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for edge in [edge for edge in self.seen if edge not in self.charts]:
            views = self.seen[edge]
            cameras = [estimate.atPose3(X(view)) for view, _ in views]
            found = rf.triangulate_line(cameras, [points for _, points in views], PIXEL)
            if not found.determined:
                continue
            self.charts[edge] = found.chart
            values.insert(L(edge), np.zeros(4))
            graph.add(rf.new_line_factor(WIDE, X(views[0][0]), L(edge), found.chart, cameras[0]))
            for view, points in views:
                graph.add(self.factor(edge, view, points))
        return graph, values

    def factor(self, edge: int, k: int, points: FloatArray) -> rf.RuledSurfaceFactor:
        """One edge in one view."""
        observed = rf.GeometricPoints.from_frames([points])
        noise = noiseModel.Isotropic.Sigma(observed.rows, PIXEL)
        return rf.ruled_surface_pose_factor(noise, X(k), L(edge), self.charts[edge], observed)


def cube(seed: int) -> tuple[float, float]:
    """Position RMSE (m) of all poses, without and with lines."""
    without, with_lines = (
        Cube(np.random.default_rng(seed), with_lines).run() for with_lines in (False, True)
    )
    return without, with_lines


SCENES: dict[str, Callable[[int], tuple[float, float]]] = {
    "forward twist": lambda seed: twist("forward twist", seed),
    "sick twist": lambda seed: twist("sick twist", seed),
    "visual ISAM2": cube,
}


def main() -> None:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print("Position RMSE (m), median and range; how many seeds are worse with lines")
    items = [(name, seed) for name in SCENES for seed in range(seeds)]
    found = dict(in_parallel(lambda item: SCENES[item[0]](item[1]), items, workers=2))
    for name in SCENES:
        errors = np.array([found[name, seed] for seed in range(seeds)])
        cells = [f"{np.median(e):.4f} ({e.min():.4f} to {e.max():.4f})" for e in errors.T]
        worse = int(np.sum(errors[:, 1] > errors[:, 0]))
        print(f"{name:14} without {cells[0]}   with {cells[1]}   worse {worse} of {seeds}")


if __name__ == "__main__":
    main()
