# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Segments in an image that are the same line."""

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.config import TracksConfig
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.track import LineSegments


def duplicates(
    segments: LineSegments, own: LineSegments, focal: float, config: TracksConfig
) -> NDArray[np.bool_]:
    """Which of M segments are the same line as which of N own ones, (M, N).

    `focal` is the focal length, px.
    """
    normals, along = normal_of(own.ends), own.ends[:, 1] - own.ends[:, 0]
    ends = segments.ends
    same = np.sign(segments.slopes[:, None] * own.slopes) * (normal_of(ends) @ normals.T)
    three = np.concatenate([ends, ends.mean(axis=1, keepdims=True)], axis=1)
    # Both (M, 3, N), counted from the own ones' first ends.
    gap = np.abs(three @ normals.T - np.sum(own.ends[:, 0] * normals, axis=1))
    position = three @ along.T - np.sum(own.ends[:, 0] * along, axis=1)
    position /= np.sum(along**2, axis=1)
    near = np.all(gap * focal < config.duplicate_distance_px, axis=1)
    overlap = (position.max(axis=1) > -config.duplicate_gap) & (
        position.min(axis=1) < 1.0 + config.duplicate_gap
    )
    return np.asarray((same >= config.duplicate_cosine) & near & overlap)


def first_of_duplicates(duplicates: NDArray[np.bool_]) -> list[int]:
    """Which lines to keep so that no two of them are duplicates, (N, N), an earlier one rather."""
    keep: list[int] = []
    for i in range(len(duplicates)):
        if not duplicates[i, keep].any():
            keep.append(i)
    return keep
