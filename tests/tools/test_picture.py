# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The README's picture: what it draws of a state."""

import numpy as np

import picture
from ruledgraph.core.figure_style import line_color
from ruledgraph.core.measurements import Frame
from ruledgraph.visualization.views import View
from small_simulation import SMALL

PATH = np.stack([np.linspace(0.0, 2.0, 30), np.zeros(30), np.zeros(30)], axis=1)
ENDS = np.array([[0.0, 1.0, -1.0], [2.0, 1.0, 1.0]])


def state(**changes) -> picture.State:
    image = np.full((SMALL.camera.height, SMALL.camera.width), 90, np.uint8)
    view = View(Frame(1, image), (), "tracking", 2.0)
    values = {"view": view, "path": PATH, "lines": {4: ENDS}, "surfaces": {}} | changes
    return picture.State(**values)


def colored(image, number: int) -> float:
    """Share of the image that has about a line's colour."""
    away = np.abs(np.asarray(image).astype(int) - line_color(number)).max(axis=2)
    return float(np.mean(away < 60))


def test_path_lines_and_surfaces_are_drawn():
    drawing = picture.Picture(state(), SMALL.camera)
    ends = np.array([[60.0, 80.0], [200.0, 120.0]])
    seen = [(2.0 - k / picture.RATE, ends + k) for k in range(60)][::-1]
    full = drawing.draw(state(surfaces={0: seen}))
    assert full.size == (picture.WIDTH, picture.HEIGHT)
    empty = drawing.draw(state(path=PATH[:1], lines={}))
    assert colored(full, 4) > 0.0005 > colored(empty, 4)
    assert colored(full, 0) > 0.0005 > colored(empty, 0)
    white = [float(np.mean(np.asarray(image).min(axis=2) > 240)) for image in (full, empty)]
    assert white[0] > white[1] + 0.0005
