# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Compression of points to sufficient statistics, weights, caps and time bins."""

import numpy as np
import pytest

from ruledgraph_factors import FactorError, GeometricPoints, ReprojectionPoints, bin_points


@pytest.mark.parametrize("count", [1, 2, 3, 7, 100, 2000])
def test_statistics_equal_the_weighted_sum_over_points(count: int) -> None:
    rng = np.random.default_rng(count)
    points, weights = rng.normal(size=(count, 2)) * 0.4, rng.uniform(0.1, 2.0, size=count)
    line = rng.normal(size=3)
    compressed = GeometricPoints.from_frames([points], [weights])
    distances = np.column_stack([points, np.ones(count)]) @ line
    expected = np.sum(weights * distances**2)
    assert np.sum((compressed.statistics[0] @ line) ** 2) == pytest.approx(expected, rel=1e-12)
    assert np.allclose(np.tril(compressed.statistics[0], -1), 0.0)


@pytest.mark.parametrize("count", [1, 2, 3, 40])
def test_scatter_is_what_no_line_explains(count: int) -> None:
    """It is the least squared distance of the points from any line, by the singular values."""
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 2)) * [0.3, 1e-3] + [0.1, -0.2]
    compressed = GeometricPoints.from_frames([points, 2.0 * points])
    flat = compressed.without_scatter()
    assert flat.rows == compressed.rows
    assert flat.weight == pytest.approx(compressed.weight, rel=1e-12)
    np.testing.assert_allclose(flat.middles(), compressed.middles(), atol=1e-12)
    centred = points - points.mean(axis=0)
    least = np.linalg.svd(centred, compute_uv=False)[-1] ** 2 if count > 2 else 0.0
    for angle in rng.uniform(0.0, np.pi, 5):
        line = np.array([np.cos(angle), np.sin(angle), rng.normal()])
        whole, rest = (np.sum((p.statistics[0] @ line) ** 2) for p in (compressed, flat))
        assert whole - rest == pytest.approx(least, abs=1e-9 * whole)
    assert np.allclose(flat.statistics[:, 2], 0.0, atol=1e-12)


def test_without_scatter_a_frame_is_chi_square_with_two_degrees_of_freedom() -> None:
    rng, sigma = np.random.default_rng(5), 2e-3
    along = np.linspace(-0.2, 0.2, 25)
    frames = [
        np.column_stack([along, 0.3 * along + 0.1 + sigma * rng.normal(size=along.size)])
        for _ in range(2000)
    ]
    flat = GeometricPoints.from_frames(frames).without_scatter()
    line = np.array([0.3, -1.0, 0.1])  # the noise is along y: distances times the norm
    squared = np.sum((flat.statistics @ line) ** 2, axis=1) / sigma**2
    # The mean of 2000 such squares deviates by 2 / sqrt(2000); four times that.
    assert squared.mean() == pytest.approx(2.0, abs=0.18)


def test_a_frame_weighs_as_much_as_its_points() -> None:
    rng = np.random.default_rng(3)
    points = [rng.normal(size=(count, 2)) * 0.4 for count in (1, 2, 15)]
    weights = [rng.uniform(0.1, 2.0, size=len(own)) for own in points]
    compressed = GeometricPoints.from_frames(points, weights)
    np.testing.assert_allclose(compressed.frame_weights, [own.sum() for own in weights])


def test_effective_points_cap_a_frame_and_leave_lighter_ones() -> None:
    rng = np.random.default_rng(0)
    frames = [rng.normal(size=(200, 2)), rng.normal(size=(5, 2))]
    free = GeometricPoints.from_frames(frames).statistics
    capped = GeometricPoints.from_frames(frames, effective_points=20.0).statistics
    np.testing.assert_allclose(capped[0], free[0] * np.sqrt(20.0 / 200.0))
    np.testing.assert_array_equal(capped[1], free[1])
    individual = ReprojectionPoints.from_frames(frames, effective_points=20.0)
    np.testing.assert_allclose(individual.sqrt_weights[:200] ** 2, 0.1)


def test_points_in_a_camera_with_another_focal_length() -> None:
    rng = np.random.default_rng(3)
    frames = [rng.normal(size=(count, 2)) for count in (2, 5, 30)]
    changed = GeometricPoints.from_frames(frames).with_focal_ratio(1.25)
    direct = GeometricPoints.from_frames([points / 1.25 for points in frames])
    for own, other in zip(changed.statistics, direct.statistics, strict=True):
        np.testing.assert_allclose(own.T @ own, other.T @ other, atol=1e-12)
    assert changed.weight == pytest.approx(37.0)
    with pytest.raises(FactorError, match="ratio must be positive"):
        changed.with_focal_ratio(0.0)


def test_rows_and_frames() -> None:
    frames = [np.zeros((4, 2)), np.ones((2, 2))]
    assert (
        GeometricPoints.from_frames(frames).frames,
        GeometricPoints.from_frames(frames).rows,
    ) == (2, 6)
    individual = ReprojectionPoints.from_frames(frames)
    assert (individual.frames, individual.rows) == (2, 12)
    np.testing.assert_array_equal(individual.frame, [0, 0, 0, 0, 1, 1])


def test_bins_share_a_time_and_lose_no_point() -> None:
    rng = np.random.default_rng(1)
    times, points = 5.0 + rng.uniform(size=500) * 0.1, rng.normal(size=(500, 2))
    bin_times, binned = bin_points(times, points, 1e-3)
    assert np.all(np.diff(bin_times) > 0.0)
    assert len(bin_times) == len(binned) <= 101
    gathered = np.concatenate(binned)
    assert sorted(map(tuple, gathered)) == sorted(map(tuple, points))
    for time, inside in zip(bin_times, binned, strict=True):
        own = times[[np.flatnonzero((points == p).all(axis=1))[0] for p in inside]]
        assert np.ptp(own) <= 1e-3
        assert time == pytest.approx(own.mean(), abs=1e-12)


def test_zero_bin_width_keeps_every_distinct_time() -> None:
    times = np.array([0.3, 0.1, 0.3, 0.2])
    points = np.arange(8.0).reshape(4, 2)
    bin_times, binned = bin_points(times, points, 0.0)
    np.testing.assert_allclose(bin_times, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(binned[2], points[[0, 2]])


ONE = [np.zeros((1, 2))]


@pytest.mark.parametrize(
    ("weights", "frame", "message"),
    [
        ([1.0, 1.0], [0.0, 0.9], "frame must count"),
        ([1.0, 1.0], [0, 2], "frame must count"),
        ([1.0, 1.0], [1, 1], "frame must count"),
        ([1.0, -1.0], [0, 1], "sqrt_weights must not be negative"),
    ],
)
def test_individual_points_check_their_fields(weights: list, frame: list, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        ReprojectionPoints(np.zeros((2, 2)), weights, frame)


@pytest.mark.parametrize("kind", [GeometricPoints, ReprojectionPoints])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([],), "points is empty: at least one"),
        (([*ONE, np.zeros((0, 2))],), r"points\[1\] is empty: leave out"),
        (([np.zeros((3, 3))],), r"points\[0\] must have shape \(N, 2\), not \(3, 3\)"),
        (([[[0.0, np.nan]]],), r"points\[0\] has a NaN or infinite value at \[0, 1\]"),
        (([[[320.0, 240.0]]],), r"points\[0\] reaches 320: image points must be normalised"),
        ((ONE, []), "weights has 0 frames, but points has 1"),
        ((ONE, [[1.0, 1.0]]), r"weights\[0\] must have shape \(1,\)"),
        ((ONE, [[-1.0]]), r"weights\[0\] must be non-negative"),
        ((ONE, [[0.0]]), r"weights\[0\] must be non-negative and not all zero"),
        ((ONE, None, 0.0), "effective_points must be positive, not 0"),
    ],
)
def test_bad_points_name_the_argument(kind, arguments: tuple, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        kind.from_frames(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], np.zeros((0, 2)), 0.1), "times is empty"),
        (([0.0, 1.0], np.zeros((1, 2)), 0.1), r"points must have shape \(2, 2\)"),
        (([0.0], np.zeros((1, 2)), -0.1), "bin_width must not be negative"),
        (([np.nan], np.zeros((1, 2)), 0.1), "times has a NaN"),
    ],
)
def test_bad_bins_name_the_argument(arguments: tuple, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        bin_points(*arguments)
