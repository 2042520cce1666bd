# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the named scenes are made of."""

from itertools import combinations

import numpy as np
import pytest

from ruledgraph.simulation import SCENES, Scene, make_scene

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("scenes")


@pytest.fixture(scope="module", params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return make_scene(request.param)


def test_lines_have_names_of_their_own_and_are_listed_once(scene: Scene) -> None:
    assert scene.lines.shape == (len(scene.line_names), 2, 3)
    assert len(set(scene.line_names)) == len(scene.line_names)
    ends = np.sort(scene.lines.round(6), axis=1).reshape(-1, 6)
    assert len(np.unique(ends, axis=0)) == len(ends)
    assert np.linalg.norm(scene.lines[:, 1] - scene.lines[:, 0], axis=1).min() > 0.02


def test_surfaces_are_textured_and_neither_black_nor_burnt_out(scene: Scene) -> None:
    for surface, texture in zip(scene.surfaces, scene.textures, strict=True):
        if surface.width * surface.height > 0.5:
            assert texture.std() > 0.3, surface.name
        if surface.is_shell:
            assert 20.0 < texture.mean() < 220.0, surface.name


def test_everything_is_inside_the_shell(scene: Scene) -> None:
    corners = np.array([s.vertices for s in scene.surfaces if s.is_shell]).reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    for surface in scene.surfaces:
        assert np.all(surface.vertices >= low - 1e-9), surface.name
        assert np.all(surface.vertices <= high + 1e-9), surface.name


def test_lines_of_the_square_share_a_plane() -> None:
    lines = main_lines(make_scene("square"))
    assert np.ptp(lines[..., 0]) < 1e-12


def test_no_two_bars_of_the_noncoplanar_scene_share_a_plane() -> None:
    lines = main_lines(make_scene("noncoplanar"))
    for one, other in combinations(lines, 2):
        first, second = one[1] - one[0], other[1] - other[0]
        normal = np.cross(first, second)
        angle = np.linalg.norm(normal) / np.linalg.norm(first) / np.linalg.norm(second)
        distance = abs((other[0] - one[0]) @ normal) / np.linalg.norm(normal)
        # Either they pass each other at a distance, or are far from meeting within the scene.
        assert angle > 0.1
        assert distance > 0.01


def main_lines(scene: Scene) -> np.ndarray:
    """The longest edge of each of the four bars or slats."""
    lengths = np.linalg.norm(scene.lines[:, 1] - scene.lines[:, 0], axis=1)
    chosen = []
    for bar in ("top", "bottom", "left", "right"):
        own = [i for i, name in enumerate(scene.line_names) if name.split(".")[0] == bar]
        chosen.append(max(own, key=lambda i: lengths[i]))
    return scene.lines[chosen]
