# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How a map of lines compares with the true ones of a simulated scene."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray

# A line runs along a true one when the cosine of their angle is no less (11 degrees).
_PARALLEL = 0.98
# Nearer to the camera (m) nothing is seen.
_NEAREST = 0.2


class LineMapAccuracy(NamedTuple):
    """Of a map; shares are nan where there is nothing to share."""

    lines: int
    """In the map."""
    precision: float
    """Share of them that lie on a true line."""
    recall: float
    """Share of the true lines in view that have a line of the map."""
    repeats: float
    """Lines of the map for each true line that has any; 1 is best."""
    distance: float
    """Median distance of matched lines' ends from the true segments, m."""


def line_map_accuracy(
    ends: FloatArray, true: FloatArray, in_view: NDArray[np.bool_], tolerance: float = 0.05
) -> LineMapAccuracy:
    """Match each line with the true segment from which its worse end is least far.

    Args:
        ends: of the map's lines in the true world, (L, 2, 3), m.
        true: end points of the true lines, (M, 2, 3), m.
        in_view: which of the true lines the camera could see, (M,).
        tolerance: farther from it, m, a line is not on a true one.
    """
    along = true[:, 1] - true[:, 0]
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    offset = ends[:, :, None] - true[:, 0]
    reach = np.clip(np.sum(offset * along, axis=3), 0.0, length)
    off = np.linalg.norm(offset - reach[..., None] * along, axis=3)
    steps = ends[:, 1] - ends[:, 0]
    cosine = np.abs(steps @ along.T) / np.linalg.norm(steps, axis=1, keepdims=True)
    worse = np.where(cosine >= _PARALLEL, off.max(axis=1), np.inf)
    best = worse.argmin(axis=1)
    rows = np.flatnonzero(worse.min(axis=1, initial=np.inf) <= tolerance)
    found = np.unique(best[rows])
    visible = int(np.count_nonzero(in_view))
    distances = off[rows, :, best[rows]]
    return LineMapAccuracy(
        len(ends),
        len(rows) / len(ends) if len(ends) else np.nan,
        int(np.count_nonzero(in_view[found])) / visible if visible else np.nan,
        len(rows) / len(found) if len(found) else np.nan,
        float(np.median(distances)) if len(rows) else np.nan,
    )


def points_in_view(
    points: FloatArray, camera: CameraModel, world_R_cam: FloatArray, centres: FloatArray
) -> NDArray[np.bool_]:
    """Which points (M, 3) are in the image of some of N views (N, 3, 3), (N, 3) of a pinhole; what
    is in front of them is not considered.
    """
    seen = np.einsum("nij,nmi->nmj", world_R_cam, points - centres[:, None])
    ahead = seen[..., 2] > _NEAREST
    x, y = np.moveaxis(seen[..., :2] / np.where(ahead, seen[..., 2], 1.0)[..., None], -1, 0)
    u, v = camera.fx * x + camera.cx, camera.fy * y + camera.cy
    inside = (u >= 0.0) & (u < camera.width) & (v >= 0.0) & (v < camera.height)
    return np.asarray((ahead & inside).any(axis=0))
