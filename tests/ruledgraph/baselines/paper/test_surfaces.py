# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The least squares of the paper's solver on points that are computed from known surfaces."""

import numpy as np
import pytest

from ruledgraph.baselines.paper import surfaces as module
from ruledgraph.baselines.paper.surfaces import Points, Surfaces, loss, solve

TIMES = np.linspace(0.0, 1.5, 30)


def known(seed: int) -> tuple[Surfaces, Points]:
    """Four lines as of a square scene, a motion with a jerk, points without noise."""
    rng = np.random.default_rng(seed)
    V0 = np.array([[1.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]]) + rng.normal(0, 0.2, (4, 3))
    V0 /= np.linalg.norm(V0, axis=1, keepdims=True)
    X0 = np.array([[0, -0.5, 1.6], [0, 0.5, 1.6], [-0.5, 0, 1.6], [0.5, 0, 1.6]])
    X0 = X0 + rng.normal(0, 0.1, (4, 3))
    X0 -= np.sum(X0 * V0, axis=1, keepdims=True) * V0
    surfaces = Surfaces(X0, V0, rng.normal(0, 0.2, 3), np.array([0.1, -9.8, 0.3]))
    wave = 0.2 * np.sin(2.0 * TIMES)[:, None] * rng.normal(0, 1, 3)
    gammas = 0.5 * TIMES[:, None] ** 2 * surfaces.gravity + wave
    line = np.repeat(np.arange(4), 10 * len(TIMES))
    frame = np.tile(np.repeat(np.arange(len(TIMES)), 10), 4)
    time, gamma = TIMES[frame], gammas[frame]
    alpha = rng.uniform(-0.4, 0.4, len(line))[:, None]
    Q = X0[line] + surfaces.displacement(time, gamma) + alpha * V0[line]
    return surfaces, Points(Q[:, :2] / Q[:, 2:], line, time, gamma)


@pytest.mark.parametrize("seed", range(5))
def test_the_jacobian_is_the_residuals_derivative(seed, monkeypatch):
    surfaces, points = known(seed)
    start = surfaces.perturbed(np.random.default_rng(seed), 0.05)
    functions = {}

    def spy(residuals, origin, jacobian, **_):
        functions.update(residuals=residuals, origin=origin, jacobian=jacobian)
        return type("Found", (), {"x": origin})

    monkeypatch.setattr(module, "least_squares", spy)
    solve(start, points)
    at = functions["origin"] + np.random.default_rng(9).normal(0.0, 0.02, 22)
    step = 1e-6
    numerical = np.stack(
        [
            (functions["residuals"](at + step * e) - functions["residuals"](at - step * e))
            / (2.0 * step)
            for e in np.eye(22)
        ],
        axis=1,
    )
    np.testing.assert_allclose(functions["jacobian"](at), numerical, atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_known_surfaces_are_found_again(seed):
    surfaces, points = known(seed)
    found = surfaces.perturbed(np.random.default_rng(seed), 0.05)
    for _ in range(15):  # each time held nearer to the solution
        found = solve(found, points)
    np.testing.assert_allclose(np.linalg.norm(found.V0, axis=1), 1.0)
    np.testing.assert_allclose(np.sum(found.X0 * found.V0, axis=1), 0.0, atol=1e-12)
    assert loss(found, points, len(TIMES)) < 1e-6
    np.testing.assert_allclose(found.velocity, surfaces.velocity, atol=0.03)
    np.testing.assert_allclose(found.X0, surfaces.X0, atol=0.1)


def test_points_lie_on_their_rulings():
    surfaces, points = known(1)
    for i in np.flatnonzero(points.time == TIMES[7]):
        X = surfaces.displacement(points.time[[i]], points.gamma[[i]])[0]
        assert surfaces.distances(points.p[[i]], X)[points.line[i], 0] < 1e-12


def test_what_points_say_nothing_about_stays():
    surfaces, points = known(2)
    rest = Points(points.p, points.line, np.zeros_like(points.time), np.zeros_like(points.gamma))
    found = solve(surfaces, rest)
    np.testing.assert_allclose(found.velocity, surfaces.velocity)
    np.testing.assert_allclose(found.gravity, surfaces.gravity)


def test_points_behind_the_camera_are_a_large_loss():
    surfaces, points = known(3)
    behind = Surfaces(-surfaces.X0, surfaces.V0, surfaces.velocity, surfaces.gravity)
    assert loss(behind, points, len(TIMES)) > 1.0
