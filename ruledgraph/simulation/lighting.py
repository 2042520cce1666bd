# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Light and soft shadows, painted into the textures once when a scene is made."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation.scene import Scene, Surface, Texture, border_lines

# Light is computed on a grid this wide, in texture pixels, or finer on small surfaces, and
# interpolated.
_GRID_TEXELS = 25
_MIN_CELLS = 6
# How bright white is under an irradiance of 1.
_WHITE = 255.0


@dataclass(frozen=True)
class Lamp:
    """A square lamp that shines down, and a little to all sides."""

    position: tuple[float, float, float]
    strength: float
    """Irradiance 1 m below it."""
    size: float = 0.5
    """m; the larger, the softer the shadows."""


def light(
    surfaces: Sequence[Surface], lamps: Sequence[Lamp], ambient: float, rng: np.random.Generator
) -> Scene:
    """Paint the surfaces and light them.

    Args:
        surfaces: what the scene is made of.
        lamps: where direct light comes from; it casts shadows.
        ambient: light from everywhere.
        rng: source of all randomness in the materials.
    """
    grids = [_grid(surface) for surface in surfaces]
    irradiance = _irradiance(
        np.concatenate([grid.reshape(-1, 3) for grid in grids]),
        np.repeat([s.normal for s in surfaces], [grid[..., 0].size for grid in grids], axis=0),
        [surface for surface in surfaces if surface.casts_shadow],
        lamps,
    )
    textures, first = [], 0
    for surface, grid in zip(surfaces, grids, strict=True):
        shape = grid.shape[:2]
        here = irradiance[first : first + shape[0] * shape[1]].reshape(shape) + ambient
        first += here.size
        textures.append(_paint(surface, here, rng))
    return Scene(surfaces, textures, *border_lines(surfaces))


def _grid(surface: Surface) -> FloatArray:
    """Points all over a surface, (rows, columns, 3), m."""
    cell = _GRID_TEXELS * surface.texel
    columns, rows = (
        max(_MIN_CELLS, int(np.ceil(side / cell))) for side in (surface.width, surface.height)
    )
    across = (np.arange(columns)[None, :, None] + 0.5) / columns
    along = (np.arange(rows)[:, None, None] + 0.5) / rows
    on_surface = surface.corner + across * surface.right + along * surface.down
    return np.asarray(on_surface + 1e-3 * surface.normal)


def _irradiance(
    points: FloatArray, normals: FloatArray, blockers: Sequence[Surface], lamps: Sequence[Lamp]
) -> FloatArray:
    """Direct light at points (N, 3) that face along normals (N, 3); (N,)."""
    total = np.zeros(len(points))
    for lamp in lamps:
        # Five points of the lamp: enough for a penumbra after interpolation.
        for offset in ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            source = np.asarray(lamp.position) + 0.5 * lamp.size * np.array([*offset, 0.0])
            to_lamp = source - points
            distance = np.linalg.norm(to_lamp, axis=1)
            cosine = np.einsum("ni,ni->n", to_lamp, normals) / distance
            emitted = 0.15 + 0.85 * np.maximum(to_lamp[:, 2] / distance, 0.0)
            near = np.maximum(distance, lamp.size) ** 2
            direct = 0.2 * lamp.strength * emitted * np.maximum(cosine, 0.0) / near
            # Only what matters is worth the search for shadows.
            lit = np.flatnonzero(direct > 0.004)
            shaded = _shaded(points[lit], source, blockers)
            direct[lit[shaded]] = 0.0
            total += direct
    return total


def _shaded(
    points: FloatArray, source: FloatArray, blockers: Sequence[Surface]
) -> NDArray[np.bool_]:
    """Whether something stands between each point (N, 3) and the source (3,), (N,)."""
    ray = source - points
    shaded = np.zeros(len(points), dtype=bool)
    for blocker in blockers:
        # The sides that face the lamp are enough.
        height = float((source - blocker.corner) @ blocker.normal)
        if height <= 0.0:
            continue
        slope = ray @ blocker.normal
        below = np.flatnonzero(slope > height + 1e-6)
        # Where the ray meets the plane, relative to the source.
        at = source - blocker.corner - ray[below] * (height / slope[below])[:, None]
        across = at @ (blocker.right / blocker.width**2)
        along = at @ (blocker.down / blocker.height**2)
        hit = (across > 0.0) & (across < 1.0) & (along > 0.0) & (along < 1.0)
        shaded[below[hit]] = True
    return shaded


def _paint(surface: Surface, irradiance: FloatArray, rng: np.random.Generator) -> Texture:
    reflectance = surface.material(surface.width, surface.height, surface.texel, rng)
    soft = cv2.GaussianBlur(irradiance.astype(np.float32), (3, 3), 0.8)
    height, width = reflectance.shape
    smooth = cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)
    brightness = np.clip(_WHITE * reflectance * smooth + 0.5, 0.0, 255.0)
    return np.asarray(brightness, dtype=np.uint8)
