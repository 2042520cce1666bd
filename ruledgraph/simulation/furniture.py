# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Rooms of any size, furnished along their walls, and a corridor."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ruledgraph.simulation.lighting import Lamp, light
from ruledgraph.simulation.materials import cluttered, plain, poster, wood
from ruledgraph.simulation.motion import FloatArray
from ruledgraph.simulation.scene import Material, Scene, Surface, box, panel, shell

# Between things that would touch, m: surfaces in one plane have no order.
_GAP = 0.004


@dataclass(frozen=True, eq=False)
class _Wall:
    """Places things along a wall: along it from its left end, out of it, and up from the floor."""

    name: str
    corner: FloatArray
    """Left end on the floor, seen from inside."""
    along: FloatArray
    out: FloatArray
    length: float
    height: float

    def at(self, along: float, out: float, up: float) -> FloatArray:
        """Position in the world, (3,), m."""
        return self.corner + along * self.along + out * self.out + [0.0, 0.0, up]

    def box(
        self,
        name: str,
        middle: float,
        bottom: float,
        size: tuple[float, float, float],
        material: Material,
        out: float = _GAP,
    ) -> list[Surface]:
        """A box of size (along, out, up) whose back is `out` metres off the wall."""
        width, depth, height = size
        # Its axes are the wall's, so that faces are named alike on every wall.
        axes = np.stack([self.out, -self.along, [0.0, 0.0, 1.0]], axis=1)
        centre = self.at(middle, out + 0.5 * depth, bottom + 0.5 * height)
        return box(f"{self.name}.{name}", centre, (depth, width, height), material, axes)

    def panel(
        self, name: str, middle: float, bottom: float, size: tuple[float, float], material: Material
    ) -> list[Surface]:
        """A flat thing of size (along, up) on the wall."""
        width, height = size
        centre = self.at(middle, _GAP, bottom + 0.5 * height)
        right, down = width * self.along, np.array([0.0, 0.0, -height])
        return [panel(f"{self.name}.{name}", centre, right, down, material)]

    def frame(
        self, name: str, middle: float, bottom: float, size: tuple[float, float], material: Material
    ) -> list[Surface]:
        """Four bars around a panel of that size."""
        width, height = size
        bar, thick = 0.06, 0.03
        across = (width + 2.0 * bar, thick, bar)
        upright = (bar, thick, height - 2.0 * _GAP)
        off = 0.5 * (width + bar)
        return [
            *self.box(f"{name}.top", middle, bottom + height, across, material),
            *self.box(f"{name}.bottom", middle, bottom - bar, across, material),
            *self.box(f"{name}.left", middle - off, bottom + _GAP, upright, material),
            *self.box(f"{name}.right", middle + off, bottom + _GAP, upright, material),
        ]


def _walls(bounds: FloatArray) -> list[_Wall]:
    (x0, y0, z0), (x1, y1, z1) = bounds
    x, y = np.eye(3)[:2]
    height = z1 - z0
    return [
        _Wall("far", np.array([x1, y1, z0]), -y, -x, y1 - y0, height),
        _Wall("near", np.array([x0, y0, z0]), y, x, y1 - y0, height),
        _Wall("left", np.array([x0, y1, z0]), x, -y, x1 - x0, height),
        _Wall("right", np.array([x1, y0, z0]), -x, y, x1 - x0, height),
    ]


_Thing = Callable[[_Wall, str, float, float, np.random.Generator], list[Surface]]


def _cupboard(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    height = float(rng.uniform(1.2, 2.0))
    material = wood(float(rng.uniform(0.25, 0.5)))
    return [
        *wall.box(name, middle, _GAP, (width, 0.4, height), material),
        *wall.panel(f"{name}.notice", middle, height + 0.15, (0.5 * width, 0.4), poster()),
    ]


def _table(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    top, dark = wood(float(rng.uniform(0.4, 0.6))), plain(0.15)
    leg = 0.72
    things = wall.box(f"{name}.top", middle, leg, (width, 0.6, 0.04), top)
    for side in (-1.0, 1.0):
        along = middle + side * (0.5 * width - 0.05)
        things += wall.box(f"{name}.leg", along, _GAP, (0.05, 0.05, leg - 2 * _GAP), dark, 0.5)
    size = (0.5, 0.05, 0.34)
    things += wall.box(f"{name}.screen", middle - 0.15 * width, leg + 0.12, size, plain(0.08), 0.2)
    return things + wall.panel(f"{name}.poster", middle, 1.35, (0.9, 0.6), poster())


def _shelves(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    things: list[Surface] = []
    for i in range(4):
        bottom = 0.3 + 0.42 * i
        things += wall.box(f"{name}.board{i}", middle, bottom, (width, 0.25, 0.03), wood(0.5))
        place = middle - 0.42 * width
        while place < middle + 0.2 * width:
            size = rng.uniform([0.08, 0.12, 0.12], [0.25, 0.2, 0.32])
            box_ = tuple(float(v) for v in size)
            grey = plain(float(rng.uniform(0.1, 0.7)), 0.05)
            things += wall.box(
                f"{name}.box", place + 0.5 * size[0], bottom + 0.03 + _GAP, box_, grey  # type: ignore[arg-type]
            )
            place += size[0] + float(rng.uniform(0.02, 0.3))
    return things


def _door(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    leaf = min(width, 0.9)
    material = wood(float(rng.uniform(0.2, 0.55)), 0.06)
    return [
        *wall.panel(name, middle, 0.07, (leaf, 2.0), material),
        *wall.frame(f"{name}.frame", middle, 0.07, (leaf, 2.0), plain(0.3)),
        *wall.box(f"{name}.handle", middle + 0.38 * leaf, 1.05, (0.12, 0.06, 0.025), plain(0.1)),
    ]


def _window(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    size = (min(width, 1.3), 1.1)
    return [
        *wall.panel(name, middle, 0.95, size, plain(0.92, 0.01)),
        *wall.frame(f"{name}.frame", middle, 0.95, size, plain(0.35)),
        *wall.box(f"{name}.bar", middle, 0.95 + _GAP, (0.05, 0.03, 1.1 - 2 * _GAP), plain(0.35)),
        *wall.box(f"{name}.heater", middle, 0.15, (size[0], 0.12, 0.55), plain(0.7)),
    ]


def _board(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    size = (width, 1.1)
    return [
        *wall.panel(name, middle, 0.9, size, cluttered(plain(0.8, 0.01), 3.0, 0.5)),
        *wall.frame(f"{name}.frame", middle, 0.9, size, plain(0.2)),
    ]


_THINGS: tuple[_Thing, ...] = (_cupboard, _table, _shelves, _door, _window, _board)


def room(bounds: FloatArray, rng: np.random.Generator) -> Scene:
    """A room with furniture no deeper than 0.7 m along its walls.

    Args:
        bounds: two opposite corners, (2, 3), m.
        rng: source of what stands where.
    """
    low, high = bounds
    size = high - low
    # Larger rooms have larger furniture, and coarser textures, as they are seen from further away.
    texel = float(np.clip(0.0006 * max(size), 0.004, 0.012))
    surfaces = shell(low, high, plain(0.6, 0.03), wood(0.35), plain(0.75), texel)
    for wall in _walls(bounds):
        order = list(rng.permutation(len(_THINGS)))
        place, count = 0.9, 0
        while place < wall.length - 1.6:
            thing = _THINGS[order[count % len(_THINGS)]]
            width = float(rng.uniform(1.0, 1.6))
            surfaces += thing(wall, f"{thing.__name__[1:]}{count}", place + 0.5 * width, width, rng)
            place += width + float(rng.uniform(0.3, 0.8))
            count += 1
        surfaces += wall.box("skirting", 0.5 * wall.length, _GAP, (wall.length - 0.2, 0.015, 0.08), plain(0.2), 0.02)
    lamps = []
    across = [np.linspace(low[i], high[i], max(2, round(size[i] / 4.0)) * 2 + 1)[1::2] for i in (0, 1)]
    for x in across[0]:
        for y in across[1]:
            lamps.append(Lamp((float(x), float(y), float(high[2] - 0.1)), 0.9 * float(size[2] / 3.0) ** 2, 0.8))
    return light(surfaces, lamps, 0.15, rng)


def corridor(rng: np.random.Generator) -> Scene:
    """Twenty metres of doors, notice boards, skirting and lamps."""
    bounds = np.array([[-2.0, -1.1, -1.45], [18.5, 1.1, 1.15]])
    surfaces = shell(*bounds, plain(0.62, 0.03), wood(0.3), plain(0.75), texel=0.004)
    lamps = []
    for wall in _walls(bounds):
        if wall.length < 5.0:
            surfaces += _door(wall, "door", 0.5 * wall.length, 0.9, rng)
            continue
        place, count = float(rng.uniform(0.6, 1.4)), 0
        surfaces += wall.box("skirting", 0.5 * wall.length, _GAP, (wall.length - 0.2, 0.015, 0.1), plain(0.2), 0.02)
        while place < wall.length - 1.6:
            thing = (_door, _board, _door, _window)[count % 4]
            width = 0.9 if thing is _door else float(rng.uniform(1.0, 1.4))
            surfaces += thing(wall, f"{thing.__name__[1:]}{count}", place + 0.5 * width, width, rng)
            place += width + float(rng.uniform(0.6, 1.6))
            count += 1
    for i, x in enumerate(np.arange(-0.8, 18.0, 2.6)):
        lamps.append(Lamp((float(x), 0.0, 1.0), 0.9, 0.6))
        surfaces += box(f"lamp{i}", (x, 0.0, 1.12), (1.2, 0.2, 0.05), plain(1.0, 0.0))
    return light(surfaces, lamps, 0.2, rng)
