# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Edge points of a rolling shutter, moved to the time of the middle row.

The rotation is the gyroscope's. How the translation moves a line across its image follows from the
estimate, once the line is in the graph. Before, its track measures it: the rate from one sighting
to the next is the line's own in between, as both are of nearly the same rows. A sighting is moved
by the last rate at first, and by the mean of the rates before and after it when the next one comes.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.line_geometry import THROUGH_CENTRE
from ruledgraph.core.line_observations import PluckerEstimate, Sighting
from ruledgraph.frontend.edge_batch import Edges, Rulings, moved_ends
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.row_motion import (
    MovingRulings,
    RowMotion,
    StraightPoints,
    displacements,
)
from ruledgraph.frontend.track import Track, Unsettled
from ruledgraph_factors import GeometricPoints


class RowMoves(NamedTuple):
    """How the rows of one image move, and N tracks in it."""

    rows: RowMotion
    moves: FloatArray
    """(N, 2, 2), see `MovingRulings`."""
    estimated: NDArray[np.bool_]
    """Which of them follow from the estimate, (N,); the others are those of the image before."""

    def part(self, which: NDArray[np.bool_]) -> "RowMoves":
        """Of some tracks."""
        return RowMoves(self.rows, self.moves[which], self.estimated[which])

    def along(self, rulings: Rulings) -> MovingRulings:
        """Of the tracks' rulings."""
        return MovingRulings(self.rows, rulings.ends, self.moves)


def row_moves(
    tracks: Sequence[Track],
    rulings: Rulings,
    lines: Mapping[int, PluckerEstimate],
    world_T_cam: gtsam.Pose3,
    rows: RowMotion,
) -> RowMoves:
    """By the line of the graph, where there is one in `lines`, else as in the image before.

    `world_T_cam` is the camera's pose at the middle row.
    """
    moves = np.array([track.moves for track in tracks]).reshape(-1, 2, 2)
    estimated = np.array([track.id in lines for track in tracks], dtype=bool)
    if rows.positions is None:
        return RowMoves(rows, moves, np.zeros_like(estimated))
    if estimated.any():
        known = np.array([lines[t.id].plucker for t in tracks if t.id in lines])
        moves[estimated] = estimated_moves(rulings.ends[estimated], known, world_T_cam, rows)
    return RowMoves(rows, moves, estimated)


def estimated_moves(
    ends: FloatArray, plucker: FloatArray, world_T_cam: gtsam.Pose3, rows: RowMotion
) -> FloatArray:
    """Moves (N, 2, 2) of lines' rulings with these ends (N, 2, 2), from the lines (N, 6) in the
    world: with n(t) = m - c(t) x v a ruling is off an end (x, y, s) by its product with n / |n_xy|,
    s being the focal ratio, exact at the first row and at the last.
    """
    R = world_T_cam.rotation().matrix()
    moment = (plucker[:, :3] - np.cross(world_T_cam.translation(), plucker[:, 3:])) @ R
    direction = plucker[:, 3:] @ R
    assert rows.positions is not None  # noqa: S101 - asked before
    of_ends = np.concatenate([ends, np.full((len(ends), 2, 1), rows.focal_ratio)], axis=2)
    normals, off = normal_of(ends), []
    for centre in (rows.positions[0], rows.positions[-1]):
        n = moment - np.cross(centre, direction)
        size = np.maximum(np.hypot(n[:, 0], n[:, 1]), THROUGH_CENTRE)
        size *= np.sign(np.sum(n[:, :2] * normals, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            off.append(-np.einsum("nei,ni->ne", of_ends, n) / size[:, None])
    first, last = np.nan_to_num(np.array(off), posinf=0.0, neginf=0.0)
    h = rows.half
    return np.stack([(last - first) / (2.0 * h), (last + first) / (2.0 * h * h)], axis=2)


def straight_edges(
    edges: Edges, moving: MovingRulings, growth: float
) -> tuple[Edges, list[StraightPoints]]:
    """Edges with points, ends and statistics of the middle row's time; the points of each.

    `growth` is the setting `edges.end_growth`.
    """
    index = np.repeat(np.arange(len(edges.ends)), edges.counts)
    straight = moving.straightened(edges.points, index)
    stops = np.cumsum(edges.counts).tolist()
    each = [straight.part(slice(a, b)) for a, b in zip([0, *stops], stops, strict=False)]
    ends = [
        moved_ends(own, part.points, growth) for own, part in zip(moving.ends, each, strict=True)
    ]
    statistics = np.zeros((0, 3, 3))
    if each:
        statistics = GeometricPoints.from_frames([part.points for part in each]).statistics
    edges = edges._replace(
        points=straight.points, ends=np.array(ends).reshape(-1, 2, 2), statistics=statistics
    )
    return edges, each


def measured_moves(
    tracks: Sequence[Track], edges: Edges, known: RowMoves, time: float, focal: float
) -> RowMoves:
    """The moves of tracks found at a time (s), those outside the graph as just measured."""
    moves = known.moves.copy()
    for i, (track, (a, b)) in enumerate(zip(tracks, edges.lines.tolist(), strict=True)):
        if not known.estimated[i]:
            elapsed = max(time - track.last_seen, 1e-3)
            first, second = track.rates
            rates = first + a / elapsed, second + (a + b) / elapsed
            moves[i] = np.stack([np.array(rates) / focal, np.zeros(2)], axis=1)
    return known._replace(moves=moves)


def correct_last_sighting(track: Track, moves: FloatArray, effective_points: float) -> None:
    """Move a track's last sighting anew, by the mean of its moves and those (2, 2) measured since.

    `effective_points` is the setting `edges.effective_points`.
    """
    last, track.unsettled = track.unsettled, None
    if last is None or not track.sightings:
        return
    better = moves if last.first else 0.5 * (last.moves + moves)
    points, along, times = last.points.points, last.points.along, last.points.times
    change = np.tile(last.moves - better, (len(points), 1, 1))
    points = points + displacements(change, along, times)[:, None] * last.normal
    statistics = capped_statistics(
        np.array([len(points)]), GeometricPoints.from_frames([points]).statistics, effective_points
    )
    stamp = track.sightings[-1].stamp
    track.sightings[-1] = Sighting(stamp, points, statistics[0])


def keep_unsettled(
    tracks: Sequence[Track],
    points: Sequence[StraightPoints],
    moving: MovingRulings,
    estimated: NDArray[np.bool_] | None = None,
) -> None:
    """Take note of how the tracks' newest sightings were moved.

    `estimated` (N,) says which by the estimate: that stands.
    """
    normals = normal_of(moving.ends)
    for i, (track, own) in enumerate(zip(tracks, points, strict=True)):
        track.moves = moving.moves[i]
        if estimated is None or not estimated[i]:
            track.unsettled = Unsettled(own, normals[i], track.moves, not track.sightings)


def capped_statistics(
    counts: NDArray[np.int64], statistics: FloatArray, effective_points: float
) -> FloatArray:
    """Of edges, (N, 3, 3), as `Sighting` has them; as `GeometricPoints.from_frames` caps what a
    frame counts for.
    """
    share = np.minimum(1.0, effective_points / counts)
    return GeometricPoints(np.sqrt(share)[:, None, None] * statistics).without_scatter().statistics
