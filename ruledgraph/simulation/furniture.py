# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Rooms of any size, furnished along their walls, and a corridor."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation.lighting import Lamp, light
from ruledgraph.simulation.materials import cluttered, plain, poster, wood
from ruledgraph.simulation.scene import Material, Scene, Surface, box, panel, shell

# Between things that would touch, m: surfaces in one plane have no order.
_GAP = 0.004
# Size of a texture pixel, m.
_TEXEL = 0.004
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class _Wall:
    """Places things along a wall: along it from its left end, out of it, and up from the floor."""

    name: str
    corner: FloatArray
    """Left end on the floor, seen from inside."""
    along: FloatArray
    out: FloatArray
    length: float
    unit: float = 1.0
    """Of all lengths but the corner, m: the furniture of a hall is larger."""

    def at(self, along: float, out: float, up: float) -> FloatArray:
        """Position in the world, (3,), m."""
        return self.corner + self.unit * (along * self.along + out * self.out + up * _UP)

    def box(
        self,
        name: str,
        middle: float,
        bottom: float,
        size: tuple[float, float, float],
        material: Material,
        out: float = _GAP,
    ) -> list[Surface]:
        """A box of size (along, out, up) whose back is `out` off the wall."""
        width, depth, height = size
        # Its axes are the wall's, so that faces are named alike on every wall.
        axes = np.stack([self.out, -self.along, _UP], axis=1)
        centre = self.at(middle, out + 0.5 * depth, bottom + 0.5 * height)
        extent = self.unit * np.array([depth, width, height])
        texel = _TEXEL * self.unit
        faces = box(f"{self.name}.{name}", centre, extent, material, axes, texel)
        return [face for face in faces if not face.name.endswith("-x")]  # nobody sees its back

    def panel(
        self,
        name: str,
        middle: float,
        bottom: float,
        size: tuple[float, float],
        material: Material,
    ) -> list[Surface]:
        """A flat thing of size (along, up) on the wall."""
        width, height = size
        centre = self.at(middle, _GAP, bottom + 0.5 * height)
        right, down = self.unit * width * self.along, -self.unit * height * _UP
        texel = _TEXEL * self.unit
        return [panel(f"{self.name}.{name}", centre, right, down, material, texel=texel)]

    def frame(
        self, name: str, middle: float, bottom: float, size: tuple[float, float], material: Material
    ) -> list[Surface]:
        """Four strips around a panel of that size."""
        width, height = size
        strip, off = 0.06, 0.5 * (width + 0.06)
        across, upright = (width + 2.0 * strip, strip), (strip, height)
        return [
            *self.panel(f"{name}.top", middle, bottom + height, across, material),
            *self.panel(f"{name}.bottom", middle, bottom - strip, across, material),
            *self.panel(f"{name}.left", middle - off, bottom, upright, material),
            *self.panel(f"{name}.right", middle + off, bottom, upright, material),
        ]


def _walls(bounds: FloatArray, unit: float = 1.0) -> list[_Wall]:
    (x0, y0, z0), (x1, y1, _) = bounds
    x, y = np.eye(3)[:2]
    return [
        _Wall("far", np.array([x1, y1, z0]), -y, -x, (y1 - y0) / unit, unit),
        _Wall("near", np.array([x0, y0, z0]), y, x, (y1 - y0) / unit, unit),
        _Wall("left", np.array([x0, y1, z0]), x, -y, (x1 - x0) / unit, unit),
        _Wall("right", np.array([x1, y0, z0]), -x, y, (x1 - x0) / unit, unit),
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
    for side, off in (("left", 0.05 - 0.5 * width), ("right", 0.5 * width - 0.05)):
        along = middle + off
        things += wall.box(
            f"{name}.{side}_leg", along, _GAP, (0.05, 0.05, leg - 2 * _GAP), dark, 0.5
        )
    size = (0.5, 0.05, 0.34)
    things += wall.box(f"{name}.screen", middle - 0.15 * width, leg + 0.12, size, plain(0.08), 0.2)
    return things + wall.panel(f"{name}.poster", middle, 1.35, (0.9, 0.6), poster())


def _shelves(
    wall: _Wall, name: str, middle: float, width: float, rng: np.random.Generator
) -> list[Surface]:
    things: list[Surface] = []
    for i in range(3):
        bottom = 0.3 + 0.5 * i
        things += wall.box(f"{name}.board{i}", middle, bottom, (width, 0.25, 0.03), wood(0.5))
        place = middle - 0.42 * width
        while place < middle + 0.1 * width:
            length, depth, height = rng.uniform([0.08, 0.12, 0.12], [0.25, 0.2, 0.32]).tolist()
            grey = plain(float(rng.uniform(0.1, 0.7)), 0.05)
            along, up = place + 0.5 * length, bottom + 0.03 + _GAP
            things += wall.box(f"{name}.box{len(things)}", along, up, (length, depth, height), grey)
            place += length + float(rng.uniform(0.1, 0.4))
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
    wall: _Wall, name: str, middle: float, width: float, _rng: np.random.Generator
) -> list[Surface]:
    size = (min(width, 1.3), 1.1)
    return [
        *wall.panel(name, middle, 0.95, size, plain(0.92, 0.01)),
        *wall.frame(f"{name}.frame", middle, 0.95, size, plain(0.35)),
        *wall.box(f"{name}.bar", middle, 0.95 + _GAP, (0.05, 0.03, 1.1 - 2 * _GAP), plain(0.35)),
        *wall.box(f"{name}.heater", middle, 0.15, (size[0], 0.12, 0.55), plain(0.7)),
    ]


def _board(
    wall: _Wall, name: str, middle: float, width: float, _rng: np.random.Generator
) -> list[Surface]:
    size = (width, 1.1)
    return [
        *wall.panel(name, middle, 0.9, size, cluttered(plain(0.8, 0.01), 3.0, 0.5)),
        *wall.frame(f"{name}.frame", middle, 0.9, size, plain(0.2)),
    ]


_THINGS: tuple[_Thing, ...] = (_cupboard, _table, _shelves, _door, _window, _board)


def room(bounds: FloatArray, rng: np.random.Generator) -> Scene:
    """A room with furniture along its walls, no deeper than 1.8 m, 0.6 m in a low room.

    Args:
        bounds: two opposite corners, (2, 3), m; at least 3 m high.
        rng: source of what stands where.
    """
    low, high = bounds
    unit = float(np.clip(min(high - low) / 3.0, 1.0, 3.0))
    surfaces = shell(low, high, plain(0.6, 0.03), wood(0.35), plain(0.75), _TEXEL * unit)
    for wall in _walls(bounds, unit):
        order = rng.permutation(len(_THINGS))
        kinds = [_THINGS[i] for i in order]
        surfaces += _furnish(wall, kinds, (1.0, 1.6), (0.15, 0.5), 0.5, rng)
    return light(surfaces, _ceiling_lamps(low, high, unit), 0.25, rng)


def _ceiling_lamps(low: FloatArray, high: FloatArray, unit: float) -> list[Lamp]:
    """Two by two lamps of uneven strength, three along the sides of a wide room."""
    x, y = (
        low[i] + (np.arange(count) + 0.5) / count * (high[i] - low[i])
        for i, count in enumerate(np.clip(np.round((high - low)[:2] / (3.5 * unit)), 2, 3))
    )
    # As bright on the floor however high the room is.
    strength = 5.0 * unit**2
    places = [(float(a), float(b)) for a in x for b in y]
    return [
        Lamp((*place, float(high[2]) - 0.1), strength * (1.0, 0.65, 0.8)[i % 3], 0.8)
        for i, place in enumerate(places)
    ]


def corridor(rng: np.random.Generator) -> Scene:
    """Twenty metres of doors, notice boards, skirting and lamps."""
    bounds = np.array([[-2.0, -1.1, -1.45], [18.5, 1.1, 1.15]])
    low, high = bounds
    surfaces = shell(low, high, plain(0.62, 0.03), wood(0.3), plain(0.75), _TEXEL)
    for wall in _walls(bounds):
        if wall.name in ("far", "near"):
            surfaces += _door(wall, "door", 0.5 * wall.length, 0.9, rng)
        else:
            kinds = [_door, _board, _door, _window]
            surfaces += _furnish(
                wall, kinds, (0.9, 1.3), (0.6, 1.8), float(rng.uniform(0.6, 1.4)), rng
            )
    lamps = []
    for i, x in enumerate(np.arange(-0.8, 18.0, 3.2).tolist()):
        lamps.append(Lamp((x, 0.0, 1.0), 1.5, 0.6))
        surfaces += box(f"lamp{i}", (x, 0.0, 1.12), (1.2, 0.2, 0.05), plain(1.0, 0.0))
    return light(surfaces, lamps, 0.2, rng)


def _furnish(
    wall: _Wall,
    kinds: Sequence[_Thing],
    widths: tuple[float, float],
    gaps: tuple[float, float],
    start: float,
    rng: np.random.Generator,
) -> list[Surface]:
    """Skirting, and things in turn from `start` to the other end of a wall."""
    length = wall.length - 0.2
    things = wall.panel("skirting", 0.5 * wall.length, _GAP, (length, 0.09), plain(0.2))
    place, count = start, 0
    while place < wall.length - start - widths[1]:
        thing, width = kinds[count % len(kinds)], float(rng.uniform(*widths))
        name = f"{thing.__name__[1:]}{count}"
        things += thing(wall, name, place + 0.5 * width, width, rng)
        place += width + float(rng.uniform(*gaps))
        count += 1
    return things
