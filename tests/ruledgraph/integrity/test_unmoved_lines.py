# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines that have not moved against a motion by the IMU."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import cauchy, norm

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.integrity.unmoved_lines import log_odds_of_rest

FOCAL, DISTANCE, FACTOR, NOISE = 400.0, 3.0, 4.0, 0.1
NEEDED = -np.log1p(-Config().rest.confidence)


def lines_of(rng: np.random.Generator, count: int) -> FloatArray:
    """Through random points of the image, in random directions."""
    angle, point = rng.uniform(0.0, np.pi, count), rng.uniform(-0.6, 0.6, (count, 2))
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([normal, -np.sum(normal * point, axis=1)])


def odds(lines: FloatArray, moved: FloatArray, translation: FloatArray) -> float:
    return log_odds_of_rest(lines, moved, FOCAL * translation, DISTANCE, FACTOR)


def test_it_is_the_ratio_of_the_likelihoods():
    """By integration over the distance, of one line: with its own distance or with one for all."""
    line, moved = np.array([[0.6, 0.8, 0.1]]), np.array([0.3])
    translation = np.array([0.01, 0.002, 0.0])
    at_usual = FOCAL * abs(float(line[0] @ translation)) / DISTANCE

    def of_distance(u: float) -> float:
        return float(norm.pdf(u) * cauchy.pdf(moved[0] - at_usual / FACTOR**u, scale=NOISE))

    likelihood, _ = quad(of_distance, -5.0, 5.0, limit=400, points=[0.0, 0.5, 1.0, 1.5])
    expected = np.log(cauchy.pdf(moved[0], scale=NOISE) / likelihood)
    # The steps of a quarter of a standard deviation change it by no more.
    assert odds(line, moved, translation) == pytest.approx(expected, abs=0.2)


def test_a_body_that_moves_is_not_taken_for_one_that_rests():
    """Lines at random distances, all of them near or all of them far."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        lines = lines_of(rng, 12)
        scene = DISTANCE * FACTOR ** rng.normal()
        distances = scene * 2.0 ** rng.normal(size=12)
        translation = rng.normal(size=3) * rng.choice([0.003, 0.03, 0.1])
        moved = FOCAL * np.abs(lines @ translation) / distances
        moved = np.abs(moved + NOISE * rng.standard_cauchy(12))
        assert odds(lines, moved, translation) < NEEDED


def test_a_body_that_rests_is_found_where_its_motion_would_show():
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(300):
        lines = lines_of(rng, 12)
        direction = rng.normal(size=3)
        translation = 0.2 * direction / np.linalg.norm(direction)
        moved = np.abs(NOISE * rng.standard_cauchy(12))
        found += odds(lines, moved, translation) > NEEDED
        assert abs(odds(lines, moved, 1e-6 * translation)) < 0.1
    assert found > 240  # four in five


def test_lines_along_the_motion_say_nothing():
    rng = np.random.default_rng(2)
    lines = np.column_stack([np.zeros(10), np.ones(10), rng.uniform(-0.5, 0.5, 10)])
    moved = np.abs(NOISE * rng.standard_cauchy(10))
    assert odds(lines, moved, np.array([0.5, 0.0, 0.0])) == pytest.approx(0.0, abs=1e-6)
    # Unless one crosses it: that it moves is enough.
    crossing = np.array([[1.0, 0.0, 0.2]])
    with_one = odds(np.vstack([lines, crossing]), np.append(moved, 3.0), np.array([0.05, 0.0, 0.0]))
    assert with_one < -2.0
