# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The batch of a first window against GTSAM, factor by factor and solver by solver."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel

from ideal_tracks import CALIBRATION, ideal_tracks
from ruledgraph.backend.line_factors import compressed_points
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.initialization.batch_problem import (
    BIAS,
    POSE,
    TIME,
    VELOCITY,
    BatchProblem,
    Estimate,
)
from ruledgraph.initialization.first_window import FirstWindow, Seen
from ruledgraph.initialization.levenberg_marquardt import minimized
from ruledgraph.initialization.prior import pose_covariance
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    line_from_ruling,
    ruled_surface_factor,
)
from simulated_window import hand_held

CHUNK, CAUCHY_PX, TIME_SIGMA = 4, 2.0, 0.01


class Case:
    """A first window, and where a hypothesis may begin: all lines at two metres."""

    def __init__(self, seed: int, timed: bool) -> None:
        made = ideal_tracks(seed, hand_held(np.random.default_rng(seed)), rate=15.0, duration=1.0)
        frames = list(range(len(made.times)))
        seen = [Seen(track, frames, list(track.sightings)) for track in made.tracks]
        config, offset = Config(), TimeOffset(0.0, TIME_SIGMA) if timed else None
        samples = made.imu.between(made.times[0], made.times[-1])
        self.timed = timed
        self.window = FirstWindow(samples, made.times.tolist(), seen, CALIBRATION, config, offset)
        camera = CALIBRATION.body_T_cam
        self.charts = [line_from_ruling(camera, s.sightings[0].points, 0.5) for s in seen]
        self.upright = gtsam.Rot3.Ypr(0.0, 0.1, -0.2)
        fixed = self.upright, gtsam.imuBias.ConstantBias(), self.charts
        self.problem = BatchProblem(self.window, *fixed, CAUCHY_PX, CHUNK)

    def estimate(self, off: float) -> Estimate:
        rng = np.random.default_rng(1)
        state = gtsam.Values()
        state.insert(POSE, gtsam.Pose3(self.upright, np.zeros(3)).retract(off * rng.normal(size=6)))
        state.insert(VELOCITY, off * rng.normal(size=3))
        state.insert(BIAS, gtsam.imuBias.ConstantBias(*(0.1 * off * rng.normal(size=(2, 3)))))
        if self.timed:
            state.insert(TIME, 0.01 * off)
        return Estimate(state, off * rng.normal(size=(len(self.charts), 4)))

    def values(self, at: Estimate) -> gtsam.Values:
        values = gtsam.Values(at.state)
        for i, delta in enumerate(at.deltas):
            values.insert(TIME + 1 + i, delta)
        return values

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """The same problem of GTSAM's own parts."""
        graph, config = gtsam.NonlinearFactorGraph(), self.window.config
        tilt = noiseModel.Gaussian.Covariance(pose_covariance(self.upright, config.start.tilt))
        graph.addPriorPose3(POSE, gtsam.Pose3(self.upright, np.zeros(3)), tilt)
        slow = noiseModel.Isotropic.Sigma(3, config.start.velocity)
        graph.addPriorVector(VELOCITY, np.zeros(3), slow)
        small = noiseModel.Diagonal.Sigmas(config.start.bias_sigmas)
        graph.addPriorConstantBias(BIAS, gtsam.imuBias.ConstantBias(), small)
        if self.timed:
            known = noiseModel.Isotropic.Sigma(1, TIME_SIGMA)
            graph.addPriorDouble(TIME, 0.0, known)
        for i in range(len(self.charts)):
            wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
            graph.addPriorVector(TIME + 1 + i, np.zeros(4), wide)
            self._add_line(graph, i)
        return graph

    def _add_line(self, graph: gtsam.NonlinearFactorGraph, i: int) -> None:
        _, frames, sightings = self.window.seen[i]
        motion = self.window.motion(gtsam.imuBias.ConstantBias(), with_time=self.timed)
        for first in range(0, len(frames), CHUNK):
            part = slice(first, first + CHUNK)
            points = compressed_points(sightings[part])
            scale = CAUCHY_PX / self.window.config.edges.sigma_px * np.sqrt(points.weight)
            noise = noiseModel.Robust.Create(
                noiseModel.mEstimator.Cauchy.Create(scale),
                noiseModel.Isotropic.Sigma(points.rows, self.window.sigma),
            )
            rest = (motion.select(frames[part]), self.charts[i], points, CALIBRATION.body_T_cam)
            gravity = self.window.config.imu.gravity_in_world
            keys = POSE, VELOCITY, BIAS, TIME + 1 + i
            time_key = TIME if self.timed else None
            graph.add(ruled_surface_factor(noise, *keys, *rest, gravity, time_key=time_key))


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("off", [1e-3, 0.1])
def test_cost_and_normal_equations_are_gtsams(timed, off):
    case = Case(3, timed)
    at = case.estimate(off)
    graph, values = case.graph(), case.values(at)
    assert case.problem.cost(at) == pytest.approx(graph.error(values), rel=1e-9)
    system, n = case.problem.linearize(at), 16 if timed else 15
    ordering = gtsam.Ordering()
    for key in values.keys():  # noqa: SIM118 - of GTSAM, sorted
        ordering.push_back(key)
    information, minus_gradient = graph.linearize(values).hessian(ordering)
    own = system.information + system.of_lines[:, :n, :n].sum(axis=0)
    np.testing.assert_allclose(own, information[:n, :n], atol=1e-9 * np.abs(information).max())
    for i, (of_line, gradient) in enumerate(zip(system.of_lines, system.gradients, strict=True)):
        rows = slice(n + 4 * i, n + 4 * (i + 1))
        scale = np.abs(of_line).max()
        np.testing.assert_allclose(of_line[n:, :n], information[rows, :n], atol=1e-9 * scale)
        np.testing.assert_allclose(of_line[n:, n:], information[rows, rows], atol=1e-9 * scale)
        np.testing.assert_allclose(gradient[n:], -minus_gradient[rows], rtol=1e-6, atol=1e-6)
    gradient = system.gradient + system.gradients[:, :n].sum(axis=0)
    size = np.abs(minus_gradient[:n]).max()
    np.testing.assert_allclose(gradient, -minus_gradient[:n], atol=1e-9 * size)


@pytest.mark.parametrize("seed", range(3))
def test_it_comes_as_low_as_gtsams_levenberg_marquardt(seed):
    case = Case(seed, timed=True)
    begin = case.estimate(0.0)
    found = minimized(case.problem, begin, iterations=50)
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(50)
    params.setRelativeErrorTol(1e-4)
    params.setDiagonalDamping(True)
    graph = case.graph()
    theirs = gtsam.LevenbergMarquardtOptimizer(graph, case.values(begin), params).optimize()
    own = case.problem.cost(found)
    assert own < 0.1 * case.problem.cost(begin)
    # Both end where a step lowers the cost by less than 1e-4 of it.
    assert own < 1.01 * graph.error(theirs)


def test_without_iterations_it_stays():
    case = Case(0, timed=False)
    begin = case.estimate(0.01)
    assert minimized(case.problem, begin, iterations=0) is begin
