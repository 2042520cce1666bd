# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What surfaces are made of: reflectance with texture at several scales."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.simulation.scene import Material

Image: TypeAlias = NDArray[np.float32]


def _shape(width: float, height: float, texel: float) -> tuple[int, int]:
    return max(2, round(height / texel)), max(2, round(width / texel))


def _noise(shape: tuple[int, int], cell: float, rng: np.random.Generator) -> Image:
    """Smooth noise of unit deviation whose features are `cell` texture pixels wide."""
    rows, columns = (int(np.ceil(size / cell)) + 3 for size in shape)
    coarse = rng.standard_normal((rows, columns), dtype=np.float32)
    scale = cv2.resize(coarse, None, fx=cell, fy=cell, interpolation=cv2.INTER_CUBIC)
    first = int(cell)
    return np.asarray(scale[first : first + shape[0], first : first + shape[1]], dtype=np.float32)


def plain(reflectance: float, mottle: float = 0.02) -> Material:
    """Painted: faint stains of 0.5 m, 8 cm and 1 cm, and grain."""

    def paint(width: float, height: float, texel: float, rng: np.random.Generator) -> Image:
        shape = _shape(width, height, texel)
        image = np.full(shape, 1.0, dtype=np.float32)
        for size, strength in ((0.5, 1.0), (0.08, 0.5), (0.012, 0.7)):
            if size > texel:
                image += strength * mottle * _noise(shape, size / texel, rng)
        image += 0.5 * mottle * rng.standard_normal(shape, dtype=np.float32)
        return np.asarray(reflectance * image, dtype=np.float32)

    return paint


def wood(reflectance: float, grain: float = 0.12) -> Material:
    """Fibres along the longer side."""

    def paint(width: float, height: float, texel: float, rng: np.random.Generator) -> Image:
        shape = _shape(width, height, texel)
        upright = height > width
        lying = shape[::-1] if upright else shape
        image = np.ones(lying, dtype=np.float32)
        for along, across, strength in ((1.2, 0.03, 0.5), (0.3, 0.008, 0.3), (0.05, 0.004, 0.2)):
            rows = max(2, round(lying[0] * texel / across))
            columns = max(2, round(lying[1] * texel / along))
            fibres = rng.standard_normal((rows, columns), dtype=np.float32)
            image += (
                grain * strength * cv2.resize(fibres, lying[::-1], interpolation=cv2.INTER_CUBIC)
            )
        return np.asarray(reflectance * (image.T if upright else image), dtype=np.float32)

    return paint


def cluttered(background: Material, density: float = 6.0, contrast: float = 0.35) -> Material:
    """Stains, ellipses, arcs, short strokes and scraps on a background.

    Args:
        background: what they are painted on.
        density: of each kind, on a square metre.
        contrast: the largest change of reflectance.
    """

    def paint(width: float, height: float, texel: float, rng: np.random.Generator) -> Image:
        image = background(width, height, texel, rng)
        for _ in range(round(density * width * height)):
            _ellipse(image, texel, rng, contrast)
            _arc(image, texel, rng, contrast)
            _strokes(image, texel, rng, contrast)
            _scrap(image, texel, rng, contrast)
        return np.clip(image, 0.02, 1.0)

    return paint


def poster() -> Material:
    """A picture with a title, paragraphs of text, a photograph and a diagram."""

    def paint(width: float, height: float, texel: float, rng: np.random.Generator) -> Image:
        image = plain(float(rng.uniform(0.6, 0.85)))(width, height, texel, rng)
        rows, columns = image.shape
        top, left, right = int(0.06 * rows), int(0.08 * columns), int(0.92 * columns)
        image[
            top : top + max(2, int(0.07 * rows)), left : int(rng.uniform(0.5, 0.9) * columns)
        ] *= 0.25
        photograph = slice(int(0.18 * rows), int(0.5 * rows)), slice(left, right)
        shape = image[photograph].shape
        image[photograph] = np.clip(
            0.4 + 0.16 * sum(_noise(shape, c, rng) for c in (25, 8, 3)), 0.03, 0.9
        )
        pitch = max(3, int(0.02 / texel))
        for row in range(int(0.55 * rows), int(0.93 * rows) - pitch, pitch):
            start = left
            while start < right:
                stop = start + int(rng.uniform(0.01, 0.05) / texel)
                image[row : row + max(1, pitch // 3), start : min(stop, right)] *= 0.35
                start = stop + max(1, int(0.006 / texel))
        for _ in range(3):
            _ellipse(image, texel, rng, 0.3)
        return np.clip(image, 0.02, 1.0)

    return paint


# OpenCV draws with this many fractional bits.
_SHIFT = 4


def _fixed(values: NDArray[np.float64]) -> list[int]:
    return [round(value * 2**_SHIFT) for value in values.tolist()]


def _place(image: Image, rng: np.random.Generator) -> NDArray[np.float64]:
    return rng.uniform(0.0, 1.0, 2) * image.shape[::-1]


def _tone(
    image: Image, at: NDArray[np.float64], rng: np.random.Generator, contrast: float
) -> float:
    column, row = at.astype(int)
    here = float(image[min(row, image.shape[0] - 1), min(column, image.shape[1] - 1)])
    return float(np.clip(here + rng.uniform(-1.0, 0.6) * contrast, 0.03, 0.95))


def _ellipse(image: Image, texel: float, rng: np.random.Generator, contrast: float) -> None:
    centre, axes = _place(image, rng), rng.uniform(0.02, 0.12, 2) / texel
    angle = float(rng.uniform(0.0, 180.0))
    tone = _tone(image, centre, rng, contrast)
    cv2.ellipse(image, _fixed(centre), _fixed(axes), angle, 0, 360, tone, -1, cv2.LINE_8, _SHIFT)


def _arc(image: Image, texel: float, rng: np.random.Generator, contrast: float) -> None:
    centre, axes = _place(image, rng), rng.uniform(0.05, 0.3, 2) / texel
    angle, start = rng.uniform(0.0, 360.0, 2)
    stop = start + rng.uniform(60.0, 300.0)
    width = max(1, int(rng.uniform(0.004, 0.02) / texel))
    tone = _tone(image, centre, rng, contrast)
    cv2.ellipse(
        image, _fixed(centre), _fixed(axes), angle, start, stop, tone, width, cv2.LINE_8, _SHIFT
    )


def _strokes(image: Image, texel: float, rng: np.random.Generator, contrast: float) -> None:
    """A few short segments side by side, none as long as the lines of a scene."""
    at = _place(image, rng)
    angle, length = rng.uniform(0.0, np.pi), rng.uniform(0.04, 0.2) / texel
    along = length * np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]]) / length * rng.uniform(0.015, 0.05) / texel
    width = max(1, int(rng.uniform(0.004, 0.012) / texel))
    tone = _tone(image, at, rng, contrast)
    for i in range(int(rng.integers(1, 5))):
        start = at + i * across
        cv2.line(image, _fixed(start), _fixed(start + along), tone, width, cv2.LINE_8, _SHIFT)


def _scrap(image: Image, texel: float, rng: np.random.Generator, contrast: float) -> None:
    """An uneven polygon."""
    at = _place(image, rng)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 5))
    radii = rng.uniform(0.03, 0.12, 5) / texel
    corners = at + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    tone = _tone(image, at, rng, contrast)
    polygon = np.array([_fixed(corner) for corner in corners], dtype=np.int32)
    cv2.fillPoly(image, [polygon], (tone,), cv2.LINE_8, _SHIFT)
