# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The named scenes.

The named motions start near the world's origin, look along +x, and have y to the left and z up.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation.furniture import corridor, room
from ruledgraph.simulation.lighting import Lamp, light
from ruledgraph.simulation.materials import cluttered, plain, poster, wood
from ruledgraph.simulation.motion import Motion
from ruledgraph.simulation.scene import Material, Scene, Surface, box, panel, shell

# The laboratory around the four lines: opposite corners, m. The wall with the lines is at x = 1.6.
_LAB = np.array([[-3.0, -2.6, -1.3], [1.6, 2.4, 1.5]])
_ROOM = np.array([[-3.5, -3.5, -1.3], [3.5, 3.5, 1.7]])
_HALL = np.array([[-8.0, -7.0, -1.5], [12.0, 7.0, 5.5]])
# From a measured motion to the walls, floor and ceiling, m: more than the furniture is deep.
_CLEARANCE = np.array([2.0, 2.0, 1.0])
_MIN_HEIGHT = 3.0
_LAB_LAMPS = (Lamp((-0.6, 1.0, 1.4), 4.0, 0.6), Lamp((-1.2, -1.4, 1.4), 2.4, 0.6))


class NamedScene(NamedTuple):
    """What `--list` shows, and how it is made."""

    description: str
    build: Callable[[np.random.Generator], Scene]
    bounds: FloatArray | None = None
    """Opposite corners of a room that can have any size, (2, 3), m."""


def _laboratory(wall: Material) -> list[Surface]:
    return shell(_LAB[0], _LAB[1], wall, wood(0.3), plain(0.75))


def _clutter_around() -> list[Surface]:
    """Things about the four lines with straight edges of their own."""
    wall = _LAB[1, 0]
    return [
        panel("poster", (wall - 0.004, 1.15, 0.1), (0, -0.6, 0), (0, 0, -0.85), poster()),
        panel("notice", (wall - 0.004, -1.05, 0.45), (0, -0.3, 0.02), (0, -0.03, -0.42), poster()),
        *box("crate", (wall - 0.3, -1.25, -0.75), (0.5, 0.6, 1.1), wood(0.35)),
        *box("shelf", (wall - 0.12, 0.0, 0.95), (0.2, 1.3, 0.03), wood(0.5)),
    ]


def _square(background: Material, *around: Surface) -> Callable[[np.random.Generator], Scene]:
    """Four dark slats on the wall, 1 m apart."""
    x, half = _LAB[1, 0] - 0.002, 0.5

    def build(rng: np.random.Generator) -> Scene:
        slat = plain(0.08, 0.05)
        slats = [
            panel("top", (x, 0, half), (0, -0.88, 0), (0, 0, -0.04), slat),
            panel("bottom", (x, 0, -half), (0, -0.88, 0), (0, 0, -0.04), slat),
            panel("left", (x, half, 0), (0, -0.04, 0), (0, 0, -0.88), slat),
            panel("right", (x, -half, 0), (0, -0.04, 0), (0, 0, -0.88), slat),
        ]
        return light([*slats, *_laboratory(background), *around], _LAB_LAMPS, 0.22, rng)

    return build


def _noncoplanar(background: Material, *around: Surface) -> Callable[[np.random.Generator], Scene]:
    """Four bars between the camera and the wall, no two of them in one plane."""
    ends = {
        "top": [[1.15, 0.45, 0.55], [1.45, -0.5, 0.4]],
        "bottom": [[1.4, 0.5, -0.5], [1.05, -0.45, -0.42]],
        "left": [[1.2, 0.5, -0.4], [1.5, 0.42, 0.42]],
        "right": [[1.5, -0.45, -0.38], [1.1, -0.55, 0.4]],
    }

    def build(rng: np.random.Generator) -> Scene:
        bars: list[Surface] = []
        for name, (first, second) in ends.items():
            bars += bar(name, np.array(first), np.array(second), 0.035, plain(0.09, 0.05))
        return light([*bars, *_laboratory(background), *around], _LAB_LAMPS, 0.22, rng)

    return build


def bar(
    name: str, first: FloatArray, second: FloatArray, thickness: float, material: Material
) -> list[Surface]:
    """A square bar between two points, (3,) each, m."""
    along = second - first
    length = float(np.linalg.norm(along))
    z = along / length
    y = np.cross(z, [1.0, 0.0, 0.0])
    y /= np.linalg.norm(y)
    axes = np.stack([np.cross(y, z), y, z], axis=1)
    return box(name, 0.5 * (first + second), (thickness, thickness, length), material, axes)


_CLEAN = plain(0.62, 0.015)
_CLUTTERED = cluttered(plain(0.55, 0.03))


def _room(description: str, bounds: FloatArray) -> NamedScene:
    return NamedScene(description, lambda rng: room(bounds, rng), bounds)


SCENES: dict[str, NamedScene] = {
    "square": NamedScene("four coplanar lines on a clean wall", _square(_CLEAN)),
    "square_cluttered": NamedScene(
        "the same on a cluttered wall", _square(_CLUTTERED, *_clutter_around())
    ),
    "noncoplanar": NamedScene("four bars, no two in one plane, clean", _noncoplanar(_CLEAN)),
    "noncoplanar_cluttered": NamedScene(
        "the same before a cluttered wall", _noncoplanar(_CLUTTERED, *_clutter_around())
    ),
    "room": _room("furnished room of 7 x 7 x 3 m, or around a measured motion", _ROOM),
    "hall": _room("furnished hall of 20 x 14 x 7 m, or around a measured motion", _HALL),
    "corridor": NamedScene("corridor of 20 m with doors, skirting and lamps", corridor),
}


def make_scene(name: str, seed: int = 0, around: Motion | None = None) -> Scene:
    """A named scene.

    Args:
        name: one of `SCENES`.
        seed: for the random part of its textures and furniture; its main lines do not depend on it.
        around: a motion that the `room` or the `hall` must leave room for, instead of its own size.

    Raises:
        RuledgraphError: for a name that is not known, or a scene that cannot be fitted to a motion.
    """
    if name not in SCENES:
        raise RuledgraphError(f"unknown scene {name!r}; use one of {', '.join(SCENES)}")
    scene, rng = SCENES[name], np.random.default_rng([seed, 0])
    if around is None:
        return scene.build(rng)
    if scene.bounds is None:
        raise RuledgraphError(
            f"the scene {name} has a fixed size; a motion of its own needs a room"
        )
    return room(_bounds_around(around), rng)


def _bounds_around(motion: Motion) -> FloatArray:
    """Opposite corners, (2, 3), m, of a room that leaves a motion space."""
    positions = motion.position(np.arange(motion.start, motion.stop, 0.02))
    low, high = positions.min(axis=0) - _CLEARANCE, positions.max(axis=0) + _CLEARANCE
    high[2] = max(high[2], low[2] + _MIN_HEIGHT)
    return np.array([low, high])
