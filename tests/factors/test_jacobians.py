# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Jacobians of every factor by every argument against numerical differentiation.

The bound on the relative error is 1e-6. The numerical side is a fourth-order difference. Close to a
degeneracy no one step serves all arguments (large ones truncate, small ones round), so that several
are tried and the best counts.
"""

from collections.abc import Iterator
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from numerics import factor_jacobians, numerical_jacobian, relative_error
from random_factors import FORMS, POINTS, Case, random_case
from ruledgraph_factors import GeometricPoints, LineChart, ReprojectionPoints

BOUND = 1e-6


@cache
def shared_case(seed: int) -> Case:
    """For tests that leave it as it is: one for factors of all forms."""
    return random_case(seed)


def check(case: Case, form: str, kind, what: object, steps: tuple[float, ...] = (1e-4,)) -> bool:
    """Compare; False when all points are behind the camera and there is nothing to compare."""
    factor = case.factor(form, kind)
    analytic = factor_jacobians(factor, case.values)
    assert set(analytic) == set(factor.keys())
    for key, matrix in analytic.items():
        assert np.isfinite(matrix).all()
        errors = (
            relative_error(matrix, numerical_jacobian(factor, case.values, key, step))
            for step in steps
        )
        assert any(error < BOUND for error in errors), (what, gtsam.DefaultKeyFormatter(key))
    return any(matrix.any() for matrix in analytic.values())


def check_all(cases: Iterator[Case], form: str, kind, steps: tuple[float, ...], least: int) -> None:
    """At least `least` of the cases have to show something."""
    shown = sum(check(case, form, kind, i, steps) for i, case in enumerate(cases))
    assert shown >= least


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_random_configurations(form: str, kind) -> None:
    """1,000 configurations for each factor."""
    check_all(map(shared_case, range(1000)), form, kind, (1e-4,), least=950)


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_random_configurations_by_numpy(form: str, kind, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer: `test_kernels.py` holds both kernels to each other."""
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "numpy")
    check_all(map(shared_case, range(15)), form, kind, (1e-4,), least=14)


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", ["node", "pose"])
@pytest.mark.parametrize("distance", [0.05, 1e3, 1e6])
def test_very_near_and_very_far_lines(form: str, kind, distance: float) -> None:
    def cases() -> Iterator[Case]:
        for seed in range(50):
            case = random_case(seed, distance=distance)
            # random_case moves phi by 0.01 rad, which for a far line is across infinity.
            case.values.update(L(0), np.zeros(4))
            yield case

    check_all(cases(), form, kind, (1e-4, 1e-5, 1e-6, 1e-2, 1.0, 2e-7), least=40)


@pytest.mark.parametrize("kind", POINTS)
def test_line_at_infinity(kind) -> None:
    """Individual points a kilometre this side of it, since beyond they lose sight of the line."""
    individual = kind is ReprojectionPoints

    def cases() -> Iterator[Case]:
        for seed in range(80):
            case = random_case(seed)
            plucker, _ = case.chart.plucker(np.zeros(4))
            anchor = case.chart.world_T_anchor
            normal = anchor.rotation().rotate(case.chart.basis[:, 0])
            case.chart = LineChart.from_plucker(anchor, normal, 1e-9 * individual * plucker[3:])
            case.values.update(L(0), np.array([1e-3 * individual, 0.0, 0.0, 0.0]))
            yield case

    check_all(cases(), "node", kind, (1e-4, 1e-5, 1e-6), least=40)


@pytest.mark.parametrize("slope", [1e-2, 1e-3, 1e-5])
def test_ruling_almost_through_the_camera(slope: float) -> None:
    """|m_xy| close to zero: the line passes the camera's centre at `slope` of its distance to the
    anchor, and the image line turns that much faster."""

    def cases() -> Iterator[Case]:
        for seed in range(50):
            rng = np.random.default_rng(seed)
            case = random_case(seed)
            world_T_cam = case.values.atPose3(X(0)) * case.body_T_cam
            direction = gtsam.Rot3.Expmap(rng.normal(size=3)).matrix()[:, 0]
            across = np.cross(direction, rng.normal(size=3))
            beside = world_T_cam.translation() + slope * across / np.linalg.norm(across)
            anchor = world_T_cam.retract(np.append(np.zeros(3), rng.normal(size=3)))
            case.chart = LineChart.from_points(anchor, beside, beside + direction)
            case.values.update(L(0), np.zeros(4))
            yield case

    check_all(cases(), "pose", GeometricPoints, (1e-2 * slope, 1e-3 * slope), least=50)


@pytest.mark.parametrize("angle", [1e-1, 1e-2, 1e-3])
def test_ruling_seen_almost_end_on(angle: float) -> None:
    """The line runs almost along the ray of a point: the paper's P . P is close to zero."""

    def cases() -> Iterator[Case]:
        for seed in range(100):
            rng = np.random.default_rng(seed)
            case = random_case(seed, points=1)
            world_T_cam = case.values.atPose3(X(0)) * case.body_T_cam
            ray = np.append(case.frames[0][0], 1.0)
            aside = np.cross(ray, rng.normal(size=3))
            start = 2.0 * ray + 0.3 * aside / np.linalg.norm(aside)
            tilt = np.cross(ray, rng.normal(size=3))
            end = start + ray + angle * tilt / np.linalg.norm(tilt)
            case.chart = LineChart.from_points(
                world_T_cam, world_T_cam.transformFrom(start), world_T_cam.transformFrom(end)
            )
            case.values.update(L(0), np.zeros(4))
            yield case

    steps = (1e-3 * angle, 1e-4 * angle, 1e-5 * angle)
    check_all(cases(), "pose", ReprojectionPoints, steps, least=40)


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_residual_is_the_same_with_and_without_jacobians(form: str, kind) -> None:
    """GTSAM linearises with H and evaluates the error without: one and the same residual."""
    for seed in range(50):
        case = shared_case(seed)
        factor = case.factor(form, kind)
        _, b = factor.linearize(case.values).jacobian()
        np.testing.assert_array_equal(-b, factor.unwhitenedError(case.values))
        again = factor.linearize(case.values).jacobian()
        np.testing.assert_array_equal(b, again[1])
