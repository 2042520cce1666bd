# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A scene: textured rectangles in space, and the straight lines that bound them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruledgraph.core.arrays import FloatArray

Texture = NDArray[np.uint8]
Material = Callable[[float, float, float, np.random.Generator], NDArray[np.float32]]
"""Reflectance between 0 and 1 of a surface, from its width and height in m, the size of a texture
pixel in m and a source of randomness."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A rectangle, visible from one side: seen from there, `right` and `down` are its sides."""

    name: str
    corner: FloatArray
    """Top left, in the world, (3,), m."""
    right: FloatArray
    """To the top right corner, (3,), m."""
    down: FloatArray
    """To the bottom left corner, (3,), m."""
    material: Material
    is_shell: bool = False
    """Part of the convex room around everything else."""
    casts_shadow: bool = False
    """Thin things on a wall need not."""
    texel: float = 0.003
    """Size of a texture pixel, m; about that of an image pixel seen from nearby."""

    @property
    def width(self) -> float:
        """M."""
        return float(np.linalg.norm(self.right))

    @property
    def height(self) -> float:
        """M."""
        return float(np.linalg.norm(self.down))

    @cached_property
    def normal(self) -> FloatArray:
        """Unit normal, towards the side it is seen from, (3,)."""
        n = np.cross(self.down, self.right)
        return np.asarray(n / np.linalg.norm(n))

    @property
    def vertices(self) -> FloatArray:
        """Clockwise as seen, from the top left, (4, 3), m."""
        across = self.corner + self.right
        return np.stack([self.corner, across, across + self.down, self.corner + self.down])


@dataclass(frozen=True, eq=False)
class Scene:
    """What the camera looks at.

    The lines are the borders of all surfaces, each once; those of one object share its name up to
    the last dot.
    """

    surfaces: Sequence[Surface]
    textures: Sequence[Texture]
    """Brightness of each surface, lit: rows from top to bottom as seen, 0 to 255."""
    line_names: tuple[str, ...]
    lines: FloatArray
    """End points in the world, (M, 2, 3), m."""


def panel(
    name: str,
    centre: ArrayLike,
    right: ArrayLike,
    down: ArrayLike,
    material: Material,
    **options: bool | float,
) -> Surface:
    """A rectangle given by its centre and its two sides, (3,) each, m."""
    sides = np.asarray(right, dtype=np.float64), np.asarray(down, dtype=np.float64)
    corner = np.asarray(centre) - 0.5 * (sides[0] + sides[1])
    return Surface(name, corner, *sides, material, **options)  # type: ignore[arg-type]


def box(
    name: str,
    centre: ArrayLike,
    size: ArrayLike,
    material: Material,
    axes: ArrayLike | None = None,
    texel: float = 0.003,
) -> list[Surface]:
    """The six faces of a box.

    Args:
        name: of the box; the faces are called name.+x, name.-x and so on.
        centre: in the world, (3,), m.
        size: along its axes, (3,), m.
        material: of all faces.
        axes: of the box in the world, as the columns of a rotation (3, 3); by default the world's.
        texel: size of a texture pixel, m.
    """
    R = np.eye(3) if axes is None else np.asarray(axes, dtype=np.float64)
    extent = np.asarray(size, dtype=np.float64)
    faces = []
    for i in range(3):
        for sign, letter in ((1.0, "+"), (-1.0, "-")):
            normal = sign * R[:, i]
            j = 1 if i == 2 else 2
            down = -R[:, j]
            right = np.cross(down, -normal)
            k = 3 - i - j
            faces.append(
                panel(
                    f"{name}.{letter}{'xyz'[i]}",
                    np.asarray(centre) + 0.5 * extent[i] * normal,
                    right * extent[k],
                    down * extent[j],
                    material,
                    casts_shadow=True,
                    texel=texel,
                )
            )
    return faces


def shell(
    low: ArrayLike,
    high: ArrayLike,
    walls: Material,
    floor: Material,
    ceiling: Material,
    texel: float = 0.004,
) -> list[Surface]:
    """The inside of a room between two opposite corners, (3,) each, m."""
    bottom, top = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    surfaces = []
    names = {"+x": "far", "-x": "near", "+y": "left", "-y": "right", "+z": "ceiling", "-z": "floor"}
    inside_out = box("room", 0.5 * (bottom + top), top - bottom, walls, texel=texel)
    for face in inside_out:
        direction = face.name.rpartition(".")[2]
        material = {"+z": ceiling, "-z": floor}.get(direction, walls)
        # Seen from inside, left and right change places.
        surfaces.append(
            Surface(
                f"room.{names[direction]}",
                face.corner + face.right,
                -face.right,
                face.down,
                material,
                is_shell=True,
                texel=texel,
            )
        )
    return surfaces


def border_lines(surfaces: Sequence[Surface]) -> tuple[tuple[str, ...], FloatArray]:
    """Names and end points (M, 2, 3) of all borders, those that surfaces share only once."""
    names: dict[tuple[tuple[int, ...], ...], str] = {}
    ends = []
    for surface in surfaces:
        vertices = surface.vertices
        for i, side in enumerate(("top", "right", "bottom", "left")):
            edge = vertices[[i, (i + 1) % 4]]
            key = edge_key(edge)
            if key not in names:
                names[key] = f"{surface.name}.{side}"
                ends.append(edge)
    return tuple(names.values()), np.array(ends)


def edge_key(ends: FloatArray) -> tuple[tuple[int, ...], ...]:
    """The same for a segment (2, 3) whichever its direction and rounding errors."""
    return tuple(sorted(tuple(np.round(end * 1e6).astype(int).tolist()) for end in ends))
