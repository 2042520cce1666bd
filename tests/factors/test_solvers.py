# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Solver settings, lines moved to new charts, extrinsics and several cameras in whole graphs."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import E, L, X

from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    GeometricPoints,
    LineChart,
    check_lines,
    isam2_params,
    levenberg_marquardt_params,
    line_from_ruling,
    move_line,
    new_line_factor,
    ruled_surface_pose_factor,
    triangulate_line,
)

SIGMA = 1e-3
ENDS = np.array(
    [
        [[-0.8, -0.7, 2.0], [-0.7, 0.6, 2.4]],
        [[0.7, -0.6, 2.8], [0.8, 0.7, 2.0]],
        [[-0.7, 0.7, 2.2], [0.7, 0.6, 2.6]],
        [[-0.6, -0.6, 2.6], [0.6, -0.7, 2.0]],
    ]
)
CAMERAS = (
    gtsam.Pose3(gtsam.Rot3.Ypr(0.1, -0.1, 0.2), np.array([-0.1, 0.02, 0.0])),
    gtsam.Pose3(gtsam.Rot3.Ypr(-0.1, 0.1, 0.0), np.array([0.1, -0.02, 0.03])),
)
WIDE = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))


def seen_from(camera: gtsam.Pose3, ends: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    inside = np.array([camera.transformTo(point) for point in np.linspace(*ends, 20)])
    return inside[:, :2] / inside[:, 2:] + rng.normal(scale=SIGMA, size=(20, 2))


def poses(rng: np.random.Generator, count: int = 8) -> list[gtsam.Pose3]:
    return [
        gtsam.Pose3(gtsam.Rot3.Expmap(0.15 * rng.normal(size=3)), 0.2 * rng.normal(size=3))
        for _ in range(count)
    ]


@pytest.mark.parametrize("seed", range(3))
def test_two_cameras_with_extrinsics_are_calibrated(seed: int) -> None:
    """At known poses of the body, lines of both cameras on shared keys; NEES of the extrinsics."""
    rng = np.random.default_rng(seed)
    bodies = poses(rng)
    guesses = [camera.retract(0.02 * rng.normal(size=6)) for camera in CAMERAS]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for c, guess in enumerate(guesses):
        values.insert(E(c), guess)
    for k, body in enumerate(bodies):
        values.insert(X(k), body)
        graph.addPriorPose3(X(k), body, noiseModel.Isotropic.Sigma(6, 1e-6))
    for i, ends in enumerate(ENDS):
        views = [(k, c) for k in range(len(bodies)) for c in range(2)]
        points = [seen_from(bodies[k] * CAMERAS[c], ends, rng) for k, c in views]
        chart = triangulate_line([bodies[k] * guesses[c] for k, c in views], points, SIGMA).chart
        values.insert(L(i), np.zeros(4))
        graph.add(new_line_factor(WIDE, X(0), L(i), chart, bodies[0]))
        for (k, c), seen in zip(views, points, strict=True):
            observed = GeometricPoints.from_frames([seen])
            noise = noiseModel.Isotropic.Sigma(observed.rows, SIGMA)
            keys = (X(k), L(i))
            factor = ruled_surface_pose_factor(noise, *keys, chart, observed, extrinsics_key=E(c))
            graph.add(factor)
    params = levenberg_marquardt_params()
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    marginals = gtsam.Marginals(graph, result)
    for c, camera in enumerate(CAMERAS):
        error = result.atPose3(E(c)).localCoordinates(camera)
        assert np.linalg.norm(error) < 0.01  # a quarter of the guess's, by far
        nees = error @ np.linalg.solve(marginals.marginalCovariance(E(c)), error)
        assert nees < 22.5  # 99.9 % of chi-squared of 6
    assert all(check.ok for check in check_lines(graph, result))


def test_isam2_takes_a_line_from_a_wrong_minimum_to_the_right_one() -> None:
    rng = np.random.default_rng(1)
    cameras, ends = poses(rng), np.array([[-0.5, 0.1, 1.0], [0.6, 0.3, 6.0]])  # recedes
    points = [seen_from(camera, ends, rng) for camera in cameras]
    # From one view, at a guess that is beyond the cameras.
    wrong = line_from_ruling(cameras[0], points[0], 1 / 5.0)
    wrong, _ = wrong.recentred([-1.0, 0.0, 0.0, 0.0])
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(L(0), np.zeros(4))
    graph.addPriorVector(L(0), np.zeros(4), noiseModel.Isotropic.Sigma(4, 1e-3))
    for k, (camera, seen) in enumerate(zip(cameras, points, strict=True)):
        values.insert(X(k), camera)
        graph.addPriorPose3(X(k), camera, noiseModel.Isotropic.Sigma(6, 1e-4))
        observed = GeometricPoints.from_frames([seen])
        noise = noiseModel.Isotropic.Sigma(observed.rows, SIGMA)
        graph.add(ruled_surface_pose_factor(noise, X(k), L(0), wrong, observed))
    isam = gtsam.ISAM2(isam2_params())
    isam.update(graph, values)
    isam.update()
    factors = isam.getFactorsUnsafe()
    (check,) = check_lines(factors, isam.calculateEstimate())
    assert not check.ok

    chart = triangulate_line(cameras, points, SIGMA).chart
    moved = move_line(factors, L(0), L(1), chart)
    assert (moved.factors.size(), len(moved.indices)) == (len(cameras), len(cameras) + 1)
    start = gtsam.Values()
    start.insert(L(1), np.zeros(4))
    isam.update(moved.factors, start, moved.indices)
    isam.update()
    estimate = isam.calculateEstimate()
    assert not estimate.exists(L(0))
    (check,) = check_lines(isam.getFactorsUnsafe(), estimate)
    assert (check.key, check.ok) == (L(1), True)
    truth = LineChart.from_points(cameras[0], *ends)
    off = chart.local(*np.split(truth.plucker(np.zeros(4))[0], 2)) - estimate.atVector(L(1))
    assert np.abs(off).max() < 0.02
