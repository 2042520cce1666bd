# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the image moves, from how far lines have moved across themselves.

The median says so but for one case: a camera that moves along most of the lines it sees. These
pass through one point of the image, the direction e of the motion, and seem to rest; those that do
not pass through it move. With a line l, |l_xy| = 1, in normalised coordinates, a translation moves
the line across itself by about |l . e| times a factor that depends on its depth.
"""

from collections.abc import Iterable

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.track import Track


def moved_since(tracks: Iterable[Track], since: int) -> tuple[FloatArray, FloatArray]:
    """Image lines (N, 3) in a frame, of the tracks seen in it, as `image_motion` takes them, and
    how far each has moved across itself since, (N,), normalised coordinates.
    """
    lines, moved = [], []
    for track in tracks:
        then = next((s for s in reversed(track.sightings) if s.stamp <= since), None)
        if then is not None and then.stamp == since:
            old, new = then.points, track.sightings[-1].points
            normal = normal_of(old[[0, -1]])
            moved.append(abs(float((new.mean(axis=0) - old.mean(axis=0)) @ normal)))
            lines.append([*normal, -float(normal @ old.mean(axis=0))])
    return np.array(lines), np.array(moved)


def image_motion(lines: FloatArray, moved: FloatArray, at_rest: float, fewest: int) -> float:
    """How far the image moved.

    Args:
        lines: image lines (a, b, c) with (a, b) of unit length, normalised coordinates, (N, 3).
        moved: how far each moved across itself, (N,), no less than 0.
        at_rest: lines that moved less seem to rest, in the unit of `moved`.
        fewest: so many lines are needed, and so many that move for a motion along the others.

    Returns:
        The median of `moved`; inf where there are too few. Where lines that move, and the point
        through which those that rest pass best, explain that these seem to rest: the median of
        those that move.
    """
    if len(moved) < max(fewest, 1):
        return np.inf
    median = float(np.median(moved))
    moving = moved >= at_rest
    resting = lines[~moving]
    if moving.sum() < fewest or len(resting) < 2 or median >= at_rest:
        return median
    _, axes = np.linalg.eigh(resting.T @ resting)
    direction = axes[:, 0]
    by_motion = float(np.median(moved[moving]))
    of_moving = float(np.median(np.abs(lines[moving] @ direction)))
    # By how much the others would have moved, were it the camera's motion.
    expected = by_motion * float(np.median(np.abs(resting @ direction)))
    return by_motion if expected < at_rest * of_moving else median
