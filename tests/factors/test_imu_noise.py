# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The noise of the IMU between a state and its frames in a factor's noise model."""

import gc
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, X
from scipy.stats import chi2

from benchmarks import line_nees
from numerics import factor_jacobians
from random_factors import random_case
from ruledgraph_factors import (
    FactorError,
    ImuSamples,
    ReprojectionPoints,
    RuledSurfaceFactor,
    RuledSurfaceSpec,
    clone_graph,
    load_graph,
    move_line,
    preintegrate_frames,
    ruled_surface_factor,
    save_graph,
    with_imu_noise,
)
from ruledgraph_factors.imu_noise import motion_covariance

GYROSCOPE, ACCELEROMETER = 2e-3, 2e-2


def test_the_covariance_is_that_of_noisy_integrations() -> None:
    rng = np.random.default_rng(0)
    times, frames = np.arange(41) * 0.0025, np.array([0.0, 0.03, 0.06, 0.1])
    rate, force = np.tile([0.2, -0.1, 0.3], (41, 1)), np.tile([1.0, 0.5, 9.7], (41, 1))
    exact = preintegrate_frames(ImuSamples(times, rate, force), 0.0, frames)
    # Of samples that are interpolated: white at the density, but for the ends.
    scale = 1.0 / np.sqrt(0.0025)
    errors = []
    for _ in range(4000):
        noise = rng.normal(scale=scale, size=(2, 41, 3))
        imu = ImuSamples(times, rate + GYROSCOPE * noise[0], force + ACCELEROMETER * noise[1])
        found = preintegrate_frames(imu, 0.0, frames)
        errors.append((found.preintegrated - exact.preintegrated)[1:, :6].ravel())
    sampled = np.cov(np.array(errors).T)
    expected = motion_covariance(exact, ACCELEROMETER, GYROSCOPE)
    assert np.all(expected[0] == 0.0)  # the frame at the state itself
    expected = expected[1:, :, 1:].reshape(18, 18)
    sigmas = np.sqrt(np.diag(expected))
    # 4000 draws know a deviation to 1.1 %; the samples at the ends count half: 1 % of 0.03 s.
    np.testing.assert_allclose(np.sqrt(np.diag(sampled)), sigmas, rtol=0.06)
    np.testing.assert_allclose(
        sampled / np.outer(sigmas, sigmas), expected / np.outer(sigmas, sigmas), atol=0.12
    )


@pytest.mark.parametrize("form", ["node", "node+extrinsics", "node+focal", "node_gravity_vector"])
def test_a_factor_differs_in_its_noise_model_alone(form: str) -> None:
    case = random_case(3)
    factor = case.factor(form, sigma=0.01)
    changed = with_imu_noise(factor, case.values, ACCELEROMETER, GYROSCOPE)
    assert changed.keys() == factor.keys()
    residual = factor.unwhitenedError(case.values)
    assert np.array_equal(changed.unwhitenedError(case.values), residual)
    # H: the frame's rotation turns the state about the frame's origin, dp away from the state's.
    rows = residual.size
    added = changed.spec.noise_model.covariance() - 1e-4 * np.eye(rows)
    by_pose = 0.01 * factor_jacobians(factor, case.values)[factor.keys()[0]]  # not whitened
    position = factor.spec.motion.preintegrated[:, 3:6]
    H = np.zeros((rows, 6 * len(position)))
    for j, (x, y, z) in enumerate(position):
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        block = by_pose[3 * j : 3 * j + 3]
        H[3 * j : 3 * j + 3, 6 * j : 6 * j + 3] = block[:, :3] + block[:, 3:] @ cross
        H[3 * j : 3 * j + 3, 6 * j + 3 : 6 * j + 6] = block[:, 3:]
    P = motion_covariance(factor.spec.motion, ACCELEROMETER, GYROSCOPE).reshape(H.shape[1], -1)
    expected = H @ P @ H.T
    np.testing.assert_allclose(added, expected, atol=1e-9 * np.abs(expected).max())
    twice = with_imu_noise(factor, case.values, ACCELEROMETER, GYROSCOPE, lines=2)
    twice_added = twice.spec.noise_model.covariance() - 1e-4 * np.eye(rows)
    np.testing.assert_allclose(twice_added, 2.0 * expected, atol=1e-9 * np.abs(expected).max())


def test_sharp_edges_are_consistent_with_it() -> None:
    plain, honest = (
        np.mean([line_nees.nees(seed, 0.1, 9, imu_noise)[0] for seed in range(6)], axis=0)
        for imu_noise in (False, True)
    )
    # 95 % bounds of six runs' mean, velocity (3 degrees of freedom): 0.46 to 1.75.
    assert plain[1] > 1.75
    assert 0.46 < honest[1] < 1.75


def test_states_close_to_the_frames_are_consistent_without_it() -> None:
    found = np.mean([line_nees.nees(seed, 0.5, 3)[0] for seed in range(8)], axis=0)
    for mean, dimension in zip(found, line_nees.DIMENSIONS.values(), strict=True):
        freedom = 8 * dimension
        # One of 500 right runs would fail: 99.95 % bounds of each of four means.
        low, high = chi2.ppf([0.00025, 0.99975], freedom) / freedom
        assert low < mean < high


def test_what_it_cannot_do_is_said() -> None:
    case = random_case(3)
    figures = ACCELEROMETER, GYROSCOPE
    with pytest.raises(FactorError, match="factor must be of geometric points and of a state"):
        with_imu_noise(case.factor("pose"), case.values, *figures)
    with pytest.raises(FactorError, match="factor must be of geometric points"):
        with_imu_noise(case.factor("node", ReprojectionPoints), case.values, *figures)
    factor = case.factor("node")
    with pytest.raises(FactorError, match="lines must be at least 1, got 0"):
        with_imu_noise(factor, case.values, *figures, lines=0)
    with pytest.raises(FactorError, match="gyroscope_noise"):
        with_imu_noise(factor, case.values, ACCELEROMETER, 0.0)
    huber = noiseModel.mEstimator.Huber.Create(1.0)
    robust = noiseModel.Robust.Create(huber, noiseModel.Unit.Create(factor.spec.rows))
    spec = factor.spec
    factor = ruled_surface_factor(
        robust, *spec.keys, spec.motion, spec.chart, spec.points, gtsam.Pose3()
    )
    with pytest.raises(FactorError, match="must be Gaussian, not robust"):
        with_imu_noise(factor, case.values, *figures)


def test_it_takes_what_a_graph_hands_back() -> None:
    case = random_case(3)
    expected = with_imu_noise(case.factor("node"), case.values, ACCELEROMETER, GYROSCOPE)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(case.factor("node"))
    gc.collect()  # Python lets go of the factor
    assert type(graph.at(0)) is gtsam.CustomFactor
    found = with_imu_noise(graph.at(0), case.values, ACCELEROMETER, GYROSCOPE)
    assert found.spec.noise_model.equals(expected.spec.noise_model, 0.0)
    prior = gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), noiseModel.Unit.Create(6))
    with pytest.raises(FactorError, match="must be a ruled-surface factor, not a PriorFactorPose3"):
        with_imu_noise(prior, case.values, ACCELEROMETER, GYROSCOPE)


def test_it_does_not_add_the_noise_twice(tmp_path: Path) -> None:
    case = random_case(3)
    figures = ACCELEROMETER, GYROSCOPE
    once = with_imu_noise(case.factor("node"), case.values, *figures)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(once)
    save_graph(graph, tmp_path / "graph.npz")
    moved = move_line(graph, L(0), L(1), case.chart).factors
    stored = load_graph(tmp_path / "graph.npz")
    for factor in (once, graph.at(0), clone_graph(graph).at(0), moved.at(0), stored.at(0)):
        with pytest.raises(FactorError, match="has the IMU's noise already"):
            with_imu_noise(factor, case.values, *figures)
    plain = RuledSurfaceFactor(once.spec.with_noise(case.factor("node").spec.noise_model))
    again = with_imu_noise(plain, case.values, *figures)
    assert again.spec.noise_model.equals(once.spec.noise_model, 0.0)


def test_a_spec_of_before_there_was_such_noise_is_read() -> None:
    data = random_case(3).factor("node").spec.to_dict()
    del data["has_imu_noise"]
    assert not RuledSurfaceSpec.from_dict(data).has_imu_noise
