# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Repeated sightings of one line become one line of the map, and nothing else does."""

import time
from dataclasses import replace

import numpy as np
import pytest

from ruledgraph.backend.line_merging import merged_lines
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import MapConfig
from ruledgraph.core.estimates import LineEstimate

DEFAULT = MapConfig()
EDGE = np.array([[1.0, 0.0, 2.0], [1.0, 1.0, 2.0]])
ACROSS = np.diag([1.0, 0.0, 1.0])  # to the edge
ROOT = 3e-3 * np.kron(np.eye(2), ACROSS)  # of a covariance: 3 mm to each side at both ends


def sighting(
    ends: FloatArray, number: int = 0, root: FloatArray = ROOT, seconds: tuple[int, int] = (0, 1)
) -> LineEstimate:
    first, last = (int(1e9) * second for second in seconds)
    return LineEstimate(number, np.asarray(ends), root @ root.T, first, last, 100)


def twice(other: FloatArray, root: FloatArray = ROOT) -> list[LineEstimate]:
    """The edge, and another line later."""
    return [sighting(EDGE, 0, root), sighting(other, 1, root, (5, 6))]


def test_a_line_that_was_seen_twice_is_one_as_long_as_both():
    later = EDGE + np.array([[0.002, 0.4, 0.001], [0.002, 0.8, 0.001]])
    (line,) = merged_lines(twice(later[::-1]), DEFAULT)  # the other way round, too
    low, high = sorted(line.ends[:, 1])
    assert (low, high) == pytest.approx((0.0, 1.8), abs=0.01)
    assert (line.id, line.points, line.sightings) == (0, 200, 2)
    assert (line.first_stamp, line.last_stamp) == (0, 6_000_000_000)


def test_the_merged_line_is_the_information_weighted_mean():
    rng = np.random.default_rng(3)
    # The two ends' offsets across: 4 DoF in which both are known as stated.
    across = np.kron(np.eye(2), np.eye(3)[[0, 2]])
    roots = [2e-3 * across.T @ rng.normal(size=(4, 4)) for _ in range(2)]
    true = [root @ rng.normal(size=4) for root in roots]
    pair = [
        sighting(EDGE + x.reshape(2, 3), i, root, (5 * i, 5 * i + 1))
        for i, (x, root) in enumerate(zip(true, roots, strict=True))
    ]
    (line,) = merged_lines(pair, DEFAULT)
    A, B = (across @ root @ root.T @ across.T for root in roots)
    a, b = (across @ x for x in true)
    P = np.linalg.inv(np.linalg.inv(A) + np.linalg.inv(B))
    mean = P @ (np.linalg.solve(A, a) + np.linalg.solve(B, b))
    # Ends in the plane across one of the lines, which is tilted by some mrad: m, and a percent.
    found = line.ends[np.argsort(line.ends[:, 1])]
    np.testing.assert_allclose(across @ (found - EDGE).ravel(), mean, atol=5e-5)
    order = np.argsort(line.ends[:, 1])
    joint = line.joint_covariance.reshape(2, 3, 2, 3)[order][:, :, order].reshape(6, 6)
    np.testing.assert_allclose(across @ joint @ across.T, P, atol=0.02 * np.abs(P).max())


def test_as_many_pairs_stay_apart_as_the_confidence_says():
    rng = np.random.default_rng(8)
    apart = 0
    for _ in range(1000):
        ends = rng.uniform(-3.0, 3.0, (2, 3))
        ends[1] = ends[0] + rng.uniform(0.3, 2.0) * _unit(rng.normal(size=3))
        roots = [1.5e-3 * rng.normal(size=(6, 4)) for _ in range(2)]
        seen = [
            sighting(ends + (root @ rng.normal(size=4)).reshape(2, 3), j, root, (5 * j, 5 * j + 1))
            for j, root in enumerate(roots)
        ]
        apart += len(merged_lines(seen, DEFAULT)) == 2
    # 10 of 1000 with a standard deviation of 3.1: three of them to both sides.
    assert 1 <= apart <= 19


def test_two_edges_of_a_board_stay_two():
    """2 cm apart, known to 3 mm each: 4.7 standard deviations of the difference at both ends."""
    assert len(merged_lines(twice(EDGE + np.array([0.02, 0.0, 0.0])), DEFAULT)) == 2


def test_edges_that_were_seen_at_one_time_side_by_side_stay_two():
    close = EDGE + np.array([0.004, 0.0, 0.0])
    assert len(merged_lines([sighting(EDGE), sighting(close, 1)], DEFAULT)) == 2
    # The later sighting of one of them joins that one alone.
    lines = merged_lines(
        [sighting(EDGE), sighting(close, 1), sighting(EDGE, 2, seconds=(5, 6))], DEFAULT
    )
    assert [(line.id, line.sightings) for line in lines] == [(0, 2), (1, 1)]
    # Two pieces of one edge, seen at one time, are one behind the other.
    pieces = [sighting(EDGE), sighting(EDGE + np.array([0.0, 1.02, 0.0]), 1)]
    assert len(merged_lines(pieces, DEFAULT)) == 1


def test_lines_stay_apart_beyond_a_gap_and_at_an_angle():
    assert len(merged_lines(twice(EDGE + np.array([0.0, 1.04, 0.0])), DEFAULT)) == 1
    assert len(merged_lines(twice(EDGE + np.array([0.0, 1.06, 0.0])), DEFAULT)) == 2
    turned = EDGE + np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert len(merged_lines(twice(turned), DEFAULT)) == 2


def test_a_line_of_which_little_is_known_is_not_taken_for_another():
    """4 cm to each side: the difference fits, but so would that of many lines."""
    root = 4e-2 * np.kron(np.eye(2), ACROSS)
    assert len(merged_lines(twice(EDGE, root), DEFAULT)) == 2
    assert len(merged_lines(twice(EDGE, root), MapConfig(spacing=1.0))) == 1
    assert len(merged_lines(twice(EDGE), MapConfig(spacing=0.0))) == 2


def test_lines_of_two_segments_and_lines_without_covariance_stay_as_they_are():
    one, two = twice(EDGE)
    apart = [one, replace(two, segment=1)]
    assert merged_lines(apart, DEFAULT) == apart
    unknown = [replace(x, joint_covariance=np.full((6, 6), np.nan)) for x in (one, two)]
    assert merged_lines(unknown, DEFAULT) == unknown
    assert merged_lines([], DEFAULT) == []


def test_thousands_of_lines_take_seconds():
    """1000 lines of a room of 20 m, seen three times each; the limit is ten times what it takes."""
    rng = np.random.default_rng(5)
    lines = []
    for i in range(1000):
        direction = _unit(rng.normal(size=3))
        start = rng.uniform(-10.0, 10.0, 3)
        ends = np.array([start, start + direction])
        root = 2e-3 * rng.normal(size=(6, 4))
        for j in range(3):
            moved = ends + (root @ rng.normal(size=4)).reshape(2, 3)
            lines.append(sighting(moved, 3 * i + j, root, (10 * j, 10 * j + 1)))
    started = time.perf_counter()
    found = merged_lines(lines, DEFAULT)
    assert time.perf_counter() - started < 30.0
    # Of the 2000 later sightings about one in a hundred is rejected.
    assert 1000 <= len(found) <= 1060
    again = merged_lines(lines, DEFAULT)
    assert all(np.array_equal(a.ends, b.ends) for a, b in zip(found, again, strict=True))


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
