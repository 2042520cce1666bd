# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far the image moves, when a camera moves along most of the lines it sees."""

import numpy as np
import pytest

from ruledgraph.frontend.image_motion import image_motion

AT_REST = 0.4


def lines_through(point: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    angles = rng.uniform(0.0, np.pi, count)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.column_stack([normals, -normals @ point])


def lines_anywhere(count: int, rng: np.random.Generator) -> np.ndarray:
    points = rng.uniform(-0.5, 0.5, (count, 2))
    return np.concatenate([lines_through(point, 1, rng) for point in points])


def moved_by(lines: np.ndarray, direction: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """By a camera that moves 5 cm towards `direction`, 2 to 6 m from the lines, 400 px."""
    depth = rng.uniform(2.0, 6.0, len(lines))
    return 400.0 * np.abs(lines @ direction) * 0.05 / depth


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("sideways", [False, True])
def test_a_camera_that_moves_along_most_lines_moves(seed, sideways):
    """Along a corridor, or past bars that are parallel in the image."""
    rng = np.random.default_rng(seed)
    if sideways:
        direction, turn = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0])
        along = np.column_stack([np.tile(turn, (20, 1)), rng.uniform(-0.4, 0.4, 20)])
    else:
        direction = np.array([0.05, -0.02, 1.0])
        along = lines_through(direction[:2], 20, rng)
    lines = np.concatenate([along, lines_anywhere(8, rng)])
    moved = moved_by(lines, direction, rng) + np.abs(rng.normal(size=28)) * 0.1
    assert np.median(moved) < AT_REST
    assert image_motion(lines, moved, AT_REST, 3) > AT_REST


@pytest.mark.parametrize("seed", range(10))
def test_something_that_moves_before_a_camera_at_rest_does_not(seed):
    rng = np.random.default_rng(seed)
    lines = lines_anywhere(30, rng)
    moved = np.abs(rng.normal(size=30)) * 0.1
    moved[:10] += rng.uniform(1.0, 5.0, 10)
    assert image_motion(lines, moved, AT_REST, 3) == np.median(moved) < AT_REST


def test_parallel_lines_alone_rest_when_none_moves():
    rng = np.random.default_rng(0)
    lines = np.column_stack([np.tile([0.0, 1.0], (12, 1)), rng.uniform(-0.4, 0.4, 12)])
    moved = np.abs(rng.normal(size=12)) * 0.1
    assert image_motion(lines, moved, AT_REST, 3) == np.median(moved)
