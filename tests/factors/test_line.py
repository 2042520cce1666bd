# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The line chart: its laws, every quantity's Jacobian, and the ends of the chart."""

import gtsam
import numpy as np
import pytest

from numerics import derivative, relative_error
from ruledgraph_factors import FactorError, LineChart

SEEDS = range(200)


def random_pose(rng: np.random.Generator, reach: float = 2.0) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3) * reach)


def random_chart(rng: np.random.Generator) -> LineChart:
    first, second = rng.normal(size=(2, 3)) * 3.0
    return LineChart.from_points(random_pose(rng), first, second)


def random_delta(rng: np.random.Generator) -> np.ndarray:
    """Moves the line visibly, yet keeps phi away from the chart's ends."""
    turn, phi = rng.normal(size=3) * 0.4, rng.uniform(-0.05, 0.05)
    return np.append(phi, turn)


def on_line(plucker: np.ndarray, point: np.ndarray) -> float:
    """How far `point x v - m` is from zero, in units of |v|."""
    m, v = plucker[:3], plucker[3:]
    return float(np.linalg.norm(np.cross(point, v) - m) / np.linalg.norm(v))


def test_chart_laws() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        chart, delta = random_chart(rng), random_delta(rng)
        reference, _ = chart.plucker(np.zeros(4))
        np.testing.assert_allclose(chart.local(reference[:3], reference[3:]), 0.0, atol=1e-9)
        moved, _ = chart.plucker(delta)
        assert moved[:3] @ moved[3:] == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_allclose(chart.local(moved[:3], moved[3:]), delta, atol=1e-9)
        # Neither the scale nor the sign of Pluecker coordinates makes a difference.
        np.testing.assert_allclose(
            chart.local(-3.0 * moved[:3], -3.0 * moved[3:]), delta, atol=1e-9
        )


def test_line_from_points_runs_through_them() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        first, second = rng.normal(size=(2, 3)) * 3.0
        chart = LineChart.from_points(random_pose(rng), first, second)
        plucker, _ = chart.plucker(np.zeros(4))
        assert on_line(plucker, first) < 1e-12
        assert on_line(plucker, second) < 1e-12
        direction, _ = chart.direction(np.zeros(4))
        np.testing.assert_allclose(direction, (second - first) / np.linalg.norm(second - first))


def test_line_from_plucker_is_that_line() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        point, direction = rng.normal(size=(2, 3))
        moment = np.cross(point, direction)
        chart = LineChart.from_plucker(random_pose(rng), 0.3 * moment, 0.3 * direction)
        plucker, _ = chart.plucker(np.zeros(4))
        assert on_line(plucker, point) < 1e-12
        assert np.linalg.norm(np.cross(plucker[3:], direction)) < 1e-12
        for scale in (1e-200, 1e200):
            scaled = LineChart.from_plucker(chart.world_T_anchor, scale * moment, scale * direction)
            np.testing.assert_allclose(scaled.plucker(np.zeros(4))[0], plucker, atol=1e-12)


def test_line_from_ruling_projects_to_the_ruling_at_the_distance() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        world_T_cam = random_pose(rng)
        first, second = rng.uniform(-0.6, 0.6, size=(2, 2))
        image_line = np.cross([*first, 1.0], [*second, 1.0])
        middle = 0.5 * (first + second)
        for foot in (None, middle):
            chart = LineChart.from_ruling(world_T_cam, image_line, 0.4, foot)
            closest, _ = chart.closest_point(np.zeros(4))
            in_cam = world_T_cam.transformTo(closest)
            assert np.linalg.norm(in_cam) == pytest.approx(1.0 / 0.4)
            assert in_cam[2] > 0.0
            projected = in_cam[:2] / in_cam[2]
            assert abs(np.append(projected, 1.0) @ image_line) < 1e-12
            if foot is not None:
                np.testing.assert_allclose(projected, middle, atol=1e-12)
            # Every other point of the line projects to the ruling, too.
            ends, _ = chart.end_points(np.zeros(4), [-0.5, 0.5])
            for end in ends:
                x, y, z = world_T_cam.transformTo(end)
                assert abs(np.array([x / z, y / z, 1.0]) @ image_line) < 1e-12


QUANTITIES = {
    "plucker": lambda chart, d: chart.plucker(d),
    "direction": lambda chart, d: chart.direction(d),
    "inverse_distance": lambda chart, d: chart.inverse_distance(d),
    "closest_point": lambda chart, d: chart.closest_point(d),
    "closest_point_to": lambda chart, d: chart.closest_point(d, [0.3, -1.0, 2.0]),
    "distance_to": lambda chart, d: chart.distance_to(d, [0.3, -1.0, 2.0])[:2],
    "end_points": lambda chart, d: chart.end_points(d, [-0.7, 1.2]),
}


@pytest.mark.parametrize("name", QUANTITIES)
def test_jacobians_by_delta(name: str) -> None:
    quantity = QUANTITIES[name]
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        chart, delta = random_chart(rng), random_delta(rng)
        _, analytic = quantity(chart, delta)
        numeric = derivative(lambda d, c=chart: quantity(c, d)[0], delta, 1e-4)
        # 1e-4 steps at fourth order; far lines amplify by up to 1/sin(phi)^2.
        assert relative_error(analytic, numeric) < 1e-7, seed


def test_distance_jacobian_by_point() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        chart, delta, point = random_chart(rng), random_delta(rng), rng.normal(size=3)
        distance, _, analytic = chart.distance_to(delta, point)
        numeric = derivative(lambda p, c=chart, d=delta: c.distance_to(d, p)[0], point, 1e-4)
        assert relative_error(analytic, numeric) < 1e-7
        closest, _ = chart.closest_point(delta, point)
        assert distance == pytest.approx(np.linalg.norm(point - closest))


def test_reanchoring_keeps_the_line_and_transports_covariance() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        chart, delta, anchor = random_chart(rng), random_delta(rng), random_pose(rng)
        moved, jacobian = chart.reanchor(delta, anchor)
        old, _ = chart.plucker(delta)
        new, _ = moved.plucker(np.zeros(4))
        scale = np.linalg.norm(old[3:]) / np.linalg.norm(new[3:])
        np.testing.assert_allclose(new * scale, old, atol=1e-9)

        def local_in_new(
            d: np.ndarray, old: LineChart = chart, new: LineChart = moved
        ) -> np.ndarray:
            line, _ = old.plucker(d)
            return new.local(line[:3], line[3:])

        assert relative_error(jacobian, derivative(local_in_new, delta, 1e-4)) < 1e-6
        # A covariance means the same spread of the line's 3D points in either chart.
        covariance = np.cov(rng.normal(size=(4, 8)))
        point = rng.normal(size=3)
        _, by_old = chart.closest_point(delta, point)
        _, by_new = moved.closest_point(np.zeros(4), point)
        np.testing.assert_allclose(
            by_new @ jacobian @ covariance @ jacobian.T @ by_new.T,
            by_old @ covariance @ by_old.T,
            rtol=1e-6,
            atol=1e-9,
        )


def test_line_at_infinity() -> None:
    chart = LineChart.from_plucker(gtsam.Pose3(), [0.0, 1.0, 0.2], np.zeros(3))
    assert chart.angle == 0.0
    plucker, jacobian = chart.plucker(np.zeros(4))
    np.testing.assert_allclose(plucker[3:], 0.0, atol=1e-15)
    assert np.isfinite(jacobian).all()
    assert np.linalg.matrix_rank(jacobian, tol=1e-9) == 3  # delta[1] has no effect there
    inverse, slope = chart.inverse_distance(np.zeros(4))
    assert inverse == 0.0
    assert slope[0] == 1.0
    assert np.linalg.norm(chart.direction(np.zeros(4))[0]) == pytest.approx(1.0)
    for quantity in (
        lambda: chart.closest_point(np.zeros(4)),
        lambda: chart.distance_to(np.zeros(4), np.ones(3)),
        lambda: chart.end_points(np.zeros(4), [0.0, 1.0]),
    ):
        with pytest.raises(FactorError, match="delta: the line is at infinity"):
            quantity()
    moved, _ = chart.reanchor(np.zeros(4), gtsam.Pose3(gtsam.Rot3(), np.array([5.0, 1.0, 2.0])))
    assert moved.angle == 0.0
    # One step back from infinity it is an ordinary, far line; one step beyond, on the other side.
    near, _ = chart.closest_point([0.01, 0.0, 0.0, 0.0])
    beyond, _ = chart.closest_point([-0.01, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(near, -beyond)
    assert np.linalg.norm(near) == pytest.approx(1.0 / np.tan(0.01))


def test_line_through_the_anchors_centre() -> None:
    anchor = gtsam.Pose3(gtsam.Rot3.Ypr(0.3, 0.1, -0.2), np.array([1.0, 2.0, 3.0]))
    direction = np.array([1.0, -1.0, 0.5]) / 1.5
    chart = LineChart.from_points(anchor, anchor.translation(), anchor.translation() + direction)
    assert chart.angle == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(chart.direction(np.zeros(4))[0], direction)
    np.testing.assert_allclose(
        chart.closest_point(np.zeros(4))[0], anchor.translation(), atol=1e-12
    )
    assert chart.distance_to(np.zeros(4), anchor.translation() + 0.7 * direction)[0] < 1e-12
    _, jacobian = chart.plucker(np.zeros(4))
    assert np.linalg.matrix_rank(jacobian, tol=1e-9) == 3  # delta[2] has no effect there
    with pytest.raises(FactorError, match="runs through the new anchor's centre"):
        chart.reanchor(np.zeros(4), anchor)
    moved, _ = chart.reanchor(np.zeros(4), gtsam.Pose3())
    assert moved.distance_to(np.zeros(4), anchor.translation())[0] < 1e-12


def test_distance_on_the_line_itself_has_zero_derivative() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        chart, delta = random_chart(rng), random_delta(rng)
        point, _ = chart.closest_point(delta, rng.normal(size=3))
        distance, by_delta, by_point = chart.distance_to(delta, point)
        assert distance == pytest.approx(0.0, abs=1e-12)
        assert not by_delta.any()
        assert not by_point.any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: LineChart.from_points(gtsam.Pose3(), [1, 2, 3], [1, 2, 3]), "second: the two"),
        (
            lambda: LineChart.from_points(gtsam.Pose3(), [1, np.nan, 3], [1, 2, 3]),
            "first has a NaN",
        ),
        (lambda: LineChart.from_points(np.eye(4), [0, 0, 0], [1, 2, 3]), "world_T_anchor must be"),
        (lambda: LineChart.from_plucker(gtsam.Pose3(), np.zeros(3), np.zeros(3)), "both zero"),
        (lambda: LineChart.from_ruling(gtsam.Pose3(), [0, 0, 1], 0.5), "image_line: a and b"),
        (lambda: LineChart.from_ruling(gtsam.Pose3(), [1, 0, 1], -0.5), "inverse_distance must"),
        (lambda: LineChart.from_ruling(gtsam.Pose3(), [1, 0, 0], 0.5, [1, 0]), "foot: this image"),
        (lambda: LineChart(gtsam.Pose3(), 2.0 * np.eye(3), 0.1), "basis: its rotation is not"),
        (lambda: LineChart(gtsam.Pose3(), np.diag([1, 1, -1]), 0.1), "basis: .* reflection"),
        (lambda: LineChart(gtsam.Pose3(), np.eye(3), np.inf), "angle has a NaN or infinite"),
        (
            lambda: LineChart(gtsam.Pose3(), np.eye(3), 0.1).plucker(np.zeros(3)),
            r"delta must have shape \(4,\), not \(3,\)",
        ),
    ],
)
def test_bad_input_names_the_argument(call, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        call()


def test_no_line_wraps_silently() -> None:
    """Of 10,000 lines up to several turns away each is the only delta of its line, or is far."""
    rng = np.random.default_rng(0)
    chart, far = random_chart(rng), 0
    for delta in rng.normal(size=(10_000, 4)) * rng.uniform(0.0, 4.0, size=(10_000, 1)):
        smallest, _ = chart.wrapped(delta)
        if LineChart.is_far(delta):
            far += 1
            assert np.linalg.norm(smallest) <= np.linalg.norm(delta) + 1e-9
        else:
            np.testing.assert_allclose(smallest, delta, atol=1e-7)
    assert 2000 < far < 9000


def test_wrapped_and_recentred_are_the_same_line() -> None:
    for seed in range(30):
        rng = np.random.default_rng(seed)
        chart, delta = random_chart(rng), 3.0 * rng.normal(size=4)
        plucker, by_delta = chart.plucker(delta)
        wrapped, by_itself = chart.wrapped(delta)
        smallest, _ = chart.plucker(wrapped)
        # The sign of a line's Pluecker coordinates is free.
        np.testing.assert_allclose(
            np.outer(smallest, smallest), np.outer(plucker, plucker), atol=1e-9
        )
        np.testing.assert_allclose(wrapped, chart.local(*np.split(plucker, 2)), atol=1e-7)

        numeric = derivative(lambda d, c=chart: c.wrapped(d)[0], delta, 1e-4)
        assert relative_error(by_itself, numeric) < 1e-7

        recentred, jacobian = chart.recentred(delta)
        assert abs(recentred.angle) <= 0.5 * np.pi
        there, by_new = recentred.plucker(np.zeros(4))
        sign = np.sign(there @ plucker)
        np.testing.assert_allclose(sign * there, plucker, atol=1e-9)
        np.testing.assert_allclose(sign * by_new @ jacobian, by_delta, atol=1e-9)
