# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Normal equations of robust lines against GTSAM's, with its robust noise for each chunk."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, T, V, X

from random_factors import random_case
from ruledgraph_factors import (
    FactorError,
    GeometricPoints,
    RuledSurfaceFactor,
    RuledSurfaceSpec,
    State,
    kernel,
)
from ruledgraph_factors.robust_lines import RobustLines

SIGMA, CHUNK = 0.01, 4
# Eleven frames are chunks of four, four and three.
FRAMES, CHUNKS = (11, 4, 3), (3, 1, 1)
KERNELS = [
    "numpy",
    pytest.param(
        "native",
        marks=pytest.mark.skipif(kernel.native is None, reason="the native kernel was not built"),
    ),
]


class Case:
    """Three lines seen from one state, and values that are off."""

    def __init__(self, form: str) -> None:
        cases = [random_case(seed, frames=count) for seed, count in enumerate(FRAMES)]
        self.surfaces = [case.factor(form).spec for case in cases]
        self.state = cases[0].values
        self.deltas = np.array([case.values.atVector(L(0)) for case in cases])
        self.keys = [X(0), V(0), B(0), T(0)][: 4 if form == "node+time" else 3]
        self.scales = [np.linspace(1.0, 3.0, count) for count in CHUNKS]

    def lines(self) -> RobustLines:
        return RobustLines(self.surfaces, SIGMA, CHUNK, self.scales)

    def at(self) -> State:
        pose, bias = self.state.atPose3(X(0)).matrix(), self.state.atConstantBias(B(0)).vector()
        shift = self.state.atDouble(T(0)) if T(0) in self.keys else 0.0
        gravity = self.surfaces[0].gravity
        return State(pose, self.state.atVector(V(0)), bias, gravity, np.full(4, np.nan), shift)

    def by_gtsam(self, i: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Loss, information and gradient of a line."""
        surface, graph = self.surfaces[i], gtsam.NonlinearFactorGraph()
        for n, first in enumerate(range(0, FRAMES[i], CHUNK)):
            graph.add(RuledSurfaceFactor(self._part(surface, first, self.scales[i][n])))
        values = gtsam.Values(self.state)
        values.update(L(0), self.deltas[i])
        ordering = gtsam.Ordering()
        for key in (*self.keys, L(0)):
            ordering.push_back(key)
        information, minus_gradient = graph.linearize(values).hessian(ordering)
        return graph.error(values), information, -minus_gradient

    @staticmethod
    def _part(surface: RuledSurfaceSpec, first: int, scale: float) -> RuledSurfaceSpec:
        frames = list(range(first, min(first + CHUNK, len(surface.motion))))
        points = GeometricPoints(surface.points.statistics[frames])
        robust = noiseModel.Robust.Create(
            noiseModel.mEstimator.Cauchy.Create(scale),
            noiseModel.Isotropic.Sigma(points.rows, SIGMA),
        )
        motion = surface.motion.select(frames)
        return replace(surface, motion=motion, points=points, noise_model=robust)


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("form", ["node", "node+time"])
def test_they_are_those_of_gtsams_robust_noise(form, name, monkeypatch) -> None:
    monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
    case = Case(form)
    found = case.lines().equations(case.at(), case.deltas)
    for i in range(len(FRAMES)):
        loss, information, gradient = case.by_gtsam(i)
        assert found.losses[i] == pytest.approx(loss, rel=1e-9)
        size = np.abs(information).max()
        np.testing.assert_allclose(found.information[i], information, atol=1e-9 * size)
        np.testing.assert_allclose(found.gradient[i], gradient, atol=1e-9 * np.abs(gradient).max())


@pytest.mark.parametrize("name", KERNELS)
def test_losses_alone_are_the_same(name, monkeypatch) -> None:
    monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
    case = Case("node")
    lines = case.lines()
    losses = lines.losses(case.at(), case.deltas)
    np.testing.assert_array_equal(losses, lines.equations(case.at(), case.deltas).losses)


@pytest.mark.parametrize("name", KERNELS)
def test_squared_distances_are_those_of_the_surfaces(name, monkeypatch) -> None:
    monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
    case = Case("node")
    found = case.lines().squared_distances(case.at(), case.deltas)
    for surface, delta, squares in zip(case.surfaces, case.deltas, found, strict=True):
        values = gtsam.Values(case.state)
        values.update(L(0), delta)
        residual = RuledSurfaceFactor(surface).unwhitenedError(values)
        assert squares.sum() == pytest.approx(residual @ residual, rel=1e-9)
        assert len(squares) == len(surface.motion)


def test_the_loss_holds_what_is_far_off() -> None:
    # Else the comparison with GTSAM would be one of least squares.
    case = Case("node")
    lines = case.lines()
    squares = lines.squared_distances(case.at(), case.deltas)
    quadratic = np.array([0.5 * of_line.sum() / SIGMA**2 for of_line in squares])
    assert np.all(lines.losses(case.at(), case.deltas) < 0.5 * quadratic)


@pytest.mark.parametrize("form", ["node+focal", "node+extrinsics"])
def test_other_variables_of_the_camera_are_refused(form: str) -> None:
    with pytest.raises(FactorError, match="extrinsics and focal ratio cannot be variables"):
        Case(form).lines()
