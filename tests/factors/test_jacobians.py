# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Jacobians of every factor by every argument against numerical differentiation.

The bound on the relative error is 1e-6. The numerical side is a fourth-order difference. Close to a
degeneracy no one step serves all arguments (large ones truncate, small ones round), so that several
are tried and the best counts.
"""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from numerics import factor_jacobians, numerical_jacobian, relative_error
from random_factors import FORMS, POINTS, Case, random_case
from ruledgraph_factors import CompressedPoints, IndividualPoints, LineChart

BOUND = 1e-6


def check(case: Case, form: str, kind, what: object, steps: tuple[float, ...] = (1e-4,)) -> None:
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


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("block", range(10))
def test_random_configurations(form: str, kind, block: int) -> None:
    """1,000 configurations for each of the eight factors."""
    for seed in range(100 * block, 100 * (block + 1)):
        check(random_case(seed), form, kind, seed)


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", ["knot", "pose"])
@pytest.mark.parametrize("distance", [0.05, 1e3, 1e6])
def test_very_near_and_very_far_lines(form: str, kind, distance: float) -> None:
    for seed in range(50):
        case = random_case(seed, distance=distance)
        # delta of random_case moves phi by 0.01 rad, which for a far line is across infinity.
        case.values.update(L(0), np.zeros(4))
        check(case, form, kind, seed, steps=(1e-4, 1e-5, 1e-6, 1e-2, 1.0, 2e-7))


@pytest.mark.parametrize("kind", POINTS)
def test_line_at_infinity(kind) -> None:
    for seed in range(50):
        case = random_case(seed)
        direction, _ = case.chart.direction(np.zeros(4))
        moment = np.cross(direction, case.rng.normal(size=3))
        infinite = LineChart.from_plucker(case.chart.world_T_anchor, moment, np.zeros(3))
        case.chart = infinite
        # Beyond infinity the individual points are behind the camera: stay on this side.
        case.values.update(L(0), np.array([0.0, 0.0, 0.0, 1e-3 * (kind is IndividualPoints)]))
        check(case, "knot", kind, seed, steps=(1e-4, 1e-5, 1e-6))


@pytest.mark.parametrize("slope", [1e-2, 1e-3])
def test_ruling_almost_through_the_camera(slope: float) -> None:
    """|m_xy| close to zero: the line passes the camera's centre at a hundredth, a thousandth of its
    distance to the anchor, and the image line turns that much faster."""
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
        check(case, "pose", CompressedPoints, seed, steps=(1e-2 * slope, 1e-3 * slope))


@pytest.mark.parametrize("angle", [1e-1, 1e-2])
def test_ruling_seen_almost_end_on(angle: float) -> None:
    """The line runs almost along the ray of a point: the paper's P . P is close to zero."""
    for seed in range(50):
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
        check(
            case, "pose", IndividualPoints, seed, steps=(1e-3 * angle, 1e-4 * angle, 1e-5 * angle)
        )


@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_residual_is_the_same_with_and_without_jacobians(form: str, kind) -> None:
    """GTSAM linearises with H and evaluates the error without: one and the same residual."""
    for seed in range(50):
        case = random_case(seed)
        factor = case.factor(form, kind)
        _, b = factor.linearize(case.values).jacobian()
        np.testing.assert_array_equal(-b, factor.unwhitenedError(case.values))
        again = factor.linearize(case.values).jacobian()
        np.testing.assert_array_equal(b, again[1])
