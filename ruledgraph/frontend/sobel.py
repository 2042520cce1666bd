# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The paper's edge points: pixels whose Sobel gradient exceeds a threshold, near a ruling.

Whole pixels without polarity, on both sides of every edge: `search` is finer. Kept for comparison.

Source: Zhu, Burner, Aloimonos, arXiv 2512.00327, section on association: |dist(p, ruling)| < tau.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, EdgesConfig
from ruledgraph.frontend.edge_search import EdgePoints, Ruling, fit_line

# Of the 3x3 Sobel kernel, whose slope is eight times the grey levels per pixel.
_THRESHOLD = 25.0
# Of a grid along the ruling, px: every pixel near it is the nearest to some node.
_SPACING = 0.7


def sobel_points(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Where the Sobel gradient exceeds a threshold, (height, width)."""
    x = cv2.Sobel(image, cv2.CV_32F, 1, 0)
    y = cv2.Sobel(image, cv2.CV_32F, 0, 1)
    return np.asarray(cv2.magnitude(x, y) > _THRESHOLD)


def search_sobel(
    edges: NDArray[np.bool_],
    camera: CameraModel,
    ruling: Ruling,
    config: EdgesConfig = DEFAULTS.edges,
) -> EdgePoints | None:
    """The points near a ruling, None if there are too few.

    Args:
        edges: of the image, see `sobel_points`.
        camera: its model.
        ruling: the prediction; its uncertainty and polarity are not used.
        config: tau (`gate`), and how many points are a line.
    """
    gate, fewest = config.sobel_gate_px, config.min_points
    along_px = camera.distort(ruling.ends).pixels
    length = float(np.linalg.norm(along_px[1] - along_px[0]))
    if not (fewest <= length < 4.0 * (camera.width + camera.height)):
        return None
    positions = np.linspace(0.0, 1.0, int(length / _SPACING) + 1)
    stations = ruling.ends[0] + positions[:, None] * (ruling.ends[1] - ruling.ends[0])
    distorted = camera.distort(stations)
    tangent = np.einsum("nij,j->ni", distorted.jacobian, ruling.ends[1] - ruling.ends[0])
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    reach = np.arange(-gate - 1.0, gate + 1.0 + _SPACING, _SPACING)
    grid = distorted.pixels[:, None] + reach[:, None] * across[:, None]
    pixels = np.rint(grid).astype(np.int64).reshape(-1, 2)
    station = np.repeat(np.arange(len(positions)), len(reach))
    inside = np.all((pixels >= 0) & (pixels < [camera.width, camera.height]), axis=1)
    pixels, station = pixels[inside], station[inside]
    # Neighbouring stations reach the same pixels: each counts once.
    _, first = np.unique(pixels[:, 1] * camera.width + pixels[:, 0], return_index=True)
    pixels, station = pixels[first], station[first]
    chosen = edges[pixels[:, 1], pixels[:, 0]]
    pixels, station = pixels[chosen], station[chosen]
    offsets = np.sum((pixels - distorted.pixels[station]) * across[station], axis=1)
    near = np.abs(offsets) < gate
    pixels, station, offsets = pixels[near], station[near], offsets[near]
    order = np.argsort(station, kind="stable")
    pixels, station, offsets = pixels[order], station[order], offsets[order]
    seen, middles = _mean_by_station(station, offsets)
    support = len(seen) / len(positions)
    if len(seen) < fewest or support < config.min_support:
        return None
    points = camera.undistort(pixels.astype(np.float64), stations[station])
    if not np.isfinite(points).all():
        return None
    a, b = fit_line(positions[seen], middles)
    return EdgePoints(
        points=points,
        line=(a, b),
        support=support,
        rms_px=float(np.sqrt(np.mean((middles - a - b * positions[seen]) ** 2))),
        slope=ruling.slope,
        ambiguous=False,
    )


def _mean_by_station(
    station: NDArray[np.int64], offsets: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    seen, index, counts = np.unique(station, return_inverse=True, return_counts=True)
    return seen, np.asarray(np.bincount(index, weights=offsets, minlength=len(seen)) / counts)
