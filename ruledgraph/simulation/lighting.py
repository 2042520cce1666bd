# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Light and soft shadows, painted into the textures once when a scene is made."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.simulation.motion import FloatArray
from ruledgraph.simulation.scene import Scene, Surface, Texture, border_lines

# Light is computed on a grid this wide, m, or finer on small surfaces, and interpolated.
_GRID = 0.08
_LEAST_CELLS = 6
# How bright white is in the light of one lamp of strength 1 at a metre, of 255.
_WHITE = 255.0


@dataclass(frozen=True)
class Lamp:
    """A square lamp that shines in all directions."""

    position: tuple[float, float, float]
    strength: float
    """Irradiance at 1 m."""
    size: float = 0.5
    """m; the larger, the softer the shadows."""


def light(
    surfaces: Sequence[Surface], lamps: Sequence[Lamp], ambient: float, rng: np.random.Generator
) -> Scene:
    """Paint the surfaces and light them.

    Args:
        surfaces: what the scene is made of.
        lamps: point out of which direct light comes; it casts shadows.
        ambient: light from everywhere.
        rng: source of all randomness in the materials.
    """
    names, lines = border_lines(surfaces)
    blockers = _Blockers([surface for surface in surfaces if not surface.is_shell])
    textures = [_paint(surface, lamps, ambient, blockers, rng) for surface in surfaces]
    return Scene(surfaces, textures, names, lines)


def _paint(
    surface: Surface,
    lamps: Sequence[Lamp],
    ambient: float,
    blockers: "_Blockers",
    rng: np.random.Generator,
) -> Texture:
    reflectance = surface.material(surface.width, surface.height, surface.texel, rng)
    columns, rows = (
        max(_LEAST_CELLS, int(np.ceil(side / _GRID))) for side in (surface.width, surface.height)
    )
    across = (np.arange(columns) + 0.5) / columns
    along = (np.arange(rows) + 0.5) / rows
    points = (
        surface.corner
        + across[None, :, None] * surface.right
        + along[:, None, None] * surface.down
        + 1e-3 * surface.normal
    ).reshape(-1, 3)
    irradiance = np.full(len(points), ambient)
    for lamp in lamps:
        # Five points of the lamp: enough for a penumbra after interpolation.
        for offset in ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            source = np.asarray(lamp.position) + 0.5 * lamp.size * np.array([*offset, 0.0])
            to_lamp = source - points
            distance = np.linalg.norm(to_lamp, axis=1)
            cosine = np.maximum(to_lamp @ surface.normal / distance, 0.0)
            direct = 0.2 * lamp.strength * cosine / distance**2
            seen = cosine > 0.0
            direct[seen] *= ~blockers.between(points[seen], source)
            irradiance += direct
    grid = cv2.GaussianBlur(irradiance.reshape(rows, columns).astype(np.float32), (3, 3), 0.8)
    height, width = reflectance.shape
    smooth = cv2.resize(grid, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.clip(_WHITE * reflectance * smooth + 0.5, 0.0, 255.0).astype(np.uint8)


class _Blockers:
    """Rectangles that cast shadows."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self._corners = np.array([s.corner for s in surfaces]).reshape(-1, 3)
        self._normals = np.array([s.normal for s in surfaces]).reshape(-1, 3)
        # Dual vectors of the sides: their products with a point on it are in 0..1 inside.
        self._duals = np.array(
            [
                [s.right / np.dot(s.right, s.right), s.down / np.dot(s.down, s.down)]
                for s in surfaces
            ]
        ).reshape(-1, 2, 3)

    def between(self, points: FloatArray, source: FloatArray) -> NDArray[np.bool_]:
        """Whether a rectangle lies between each point (N, 3) and the source (3,), (N,)."""
        ray = source - points
        blocked = np.zeros(len(points), dtype=bool)
        for corner, normal, duals in zip(self._corners, self._normals, self._duals, strict=True):
            height = (source - corner) @ normal
            # One side of each object is enough.
            if height <= 0.0:
                continue
            slope = ray @ normal
            below = height - slope < -1e-6
            if not below.any():
                continue
            share = 1.0 - height / np.where(below, slope, 1.0)
            at = (points + share[:, None] * ray - corner) @ duals.T
            blocked |= below & np.all((at > 0.0) & (at < 1.0), axis=1)
        return blocked
