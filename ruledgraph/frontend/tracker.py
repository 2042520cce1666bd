# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in the image: where each was seen, and following them from frame to frame.

A track is followed by its ruling alone. While nothing is known of its depth its next ruling is
predicted from the gyroscope's rotation and its own motion across itself; once it is in the graph,
from the estimate.
"""

from collections import deque
from collections.abc import Collection, Sequence

import numpy as np

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import EdgesConfig, TracksConfig
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph.frontend.duplicates import duplicates, first_of_duplicates
from ruledgraph.frontend.edge_batch import Edges, Rulings, clipped, search_all, stacked
from ruledgraph.frontend.edge_search import scaled_to
from ruledgraph.frontend.field_of_view import field_of_view
from ruledgraph.frontend.flow_prediction import expect_motion
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.image_motion import moved_since
from ruledgraph.frontend.rolling_edges import (
    RowMoves,
    capped_statistics,
    correct_last_sighting,
    keep_unsettled,
    measured_moves,
    straight_edges,
)
from ruledgraph.frontend.row_motion import RowMotion
from ruledgraph.frontend.sobel import search_sobel, sobel_points
from ruledgraph.frontend.track import LineSegments, Track
from ruledgraph.frontend.track_starter import TrackStarter

# How far past its ends an unbounded line is searched, as a share of its length: across any image.
_UNBOUNDED = 10.0


class Tracker:
    """Follows tracks through frames and starts new ones."""

    def __init__(self, camera: CameraModel, edges: EdgesConfig, config: TracksConfig) -> None:
        self.tracks: list[Track] = []
        """Those that are followed."""
        self._ended: list[Track] = []  # lost, with sightings that are not forgotten yet
        self._edges = edges = scaled_to(camera, edges)
        self._config = config
        max_rms = {"maxima": config.max_rms_px, "sobel": config.max_rms_sobel_px}
        self._max_rms = max_rms[edges.points]
        self._time = self._elapsed = 0.0  # of the last frame, and since the one before it, s
        self.starter = TrackStarter(camera, edges, config, self._max_rms)
        self.set_camera(camera)

    def set_camera(self, camera: CameraModel) -> None:
        """Undistort points by this camera from now on, whose focal length is the same."""
        self.camera = self.starter.camera = camera
        self._low, self._high = field_of_view(camera)

    def track(
        self,
        stamp: int,
        time: float,
        gradient: Gradient,
        rulings: Rulings,
        row_moves: RowMoves | None = None,
    ) -> list[Track]:
        """Look for every track where it is predicted, a ruling for each of `tracks`; update them.

        Args:
            stamp: of the frame, ns.
            time: of the frame, s.
            gradient: of its image.
            rulings: at the frame's time.
            row_moves: of a rolling shutter.

        Returns:
            Those that were found.
        """
        self._elapsed, self._time = time - self._time, time
        ends, in_view = clipped(rulings.ends, self._low, self._high)
        rulings = rulings._replace(ends=ends).part(in_view)
        if row_moves is not None:
            row_moves = row_moves.part(in_view)
            bent, bows = row_moves.along(rulings).bent()
            edges = self._search(gradient, rulings._replace(ends=bent, bows=bows))
        else:
            edges = self._search(gradient, rulings)
        good = (edges.counts > 0) & ~edges.ambiguous & (edges.rms_px <= self._max_rms)
        found = in_view.copy()
        found[in_view] = good
        seen = []
        for track, own, is_found, is_in_view in zip(
            self.tracks, ends, found.tolist(), in_view.tolist(), strict=True
        ):
            if is_found:
                seen.append(track)
            else:
                track.ends = own
                track.miss(time)
                if not is_in_view:
                    track.mark_lost()
        if seen:
            edges = edges.part(good)
            if row_moves is not None:
                edges = self._straightened(
                    time, seen, edges, rulings.part(good), row_moves.part(good)
                )
            self._move(time, seen, edges)
            self._sight(stamp, seen, edges)
        return seen

    def _search(self, gradient: Gradient, rulings: Rulings) -> Edges:
        if self._edges.points == "sobel":
            edges, each = sobel_points(gradient.image), rulings.one_by_one()
            found = [search_sobel(edges, self.camera, ruling, self._edges) for ruling in each]
            return stacked(rulings, found, self._edges)
        beyond = self._config.search_beyond if self._edges.bounded else _UNBOUNDED
        return search_all(gradient, self.camera, rulings, beyond, self._edges)

    def _straightened(
        self,
        time: float,
        tracks: Sequence[Track],
        edges: Edges,
        rulings: Rulings,
        row_moves: RowMoves,
    ) -> Edges:
        """What was found in a rolling shutter's image, as of the middle row's time."""
        row_moves = measured_moves(tracks, edges, row_moves, time, self.camera.focal_length)
        for track, moves, estimated in zip(
            tracks, row_moves.moves, row_moves.estimated, strict=True
        ):
            if estimated:
                track.unsettled = None
            else:
                correct_last_sighting(track, moves, self._edges.effective_points)
        moving = row_moves.along(rulings)
        edges, points = straight_edges(edges, moving, self._edges.end_growth)
        keep_unsettled(tracks, points, moving, row_moves.estimated)
        return edges

    def _sight(self, stamp: int, tracks: Sequence[Track], edges: Edges) -> None:
        statistics = edges.statistics
        if tracks:
            statistics = capped_statistics(edges.counts, statistics, self._edges.effective_points)
        for i, (track, points) in enumerate(zip(tracks, edges.points_of_each(), strict=True)):
            track.sightings.append(Sighting(stamp, points, statistics[i]))

    def _move(self, time: float, tracks: Sequence[Track], edges: Edges) -> None:
        """Take tracks to where they were found."""
        along = edges.ends[:, 1] - edges.ends[:, 0]
        lengths = np.hypot(along[:, 0], along[:, 1]) * self.camera.focal_length
        rows = edges.ends, edges.lines.tolist(), edges.slopes.tolist(), lengths.tolist()
        config = self._config
        for track, ends, (a, b), slope, length in zip(tracks, *rows, strict=True):
            gain = config.rate_gain if track.misses == 0 else config.rate_gain_after_miss
            gain /= max(time - track.last_seen, 1e-3)
            first, second = track.rates
            track.rates = first + gain * a, second + gain * (a + b)
            track.ends = ends
            track.sigma = max(config.min_sigma_px, config.sigma_decay * track.sigma)
            track.slope = (1.0 - config.slope_gain) * track.slope + config.slope_gain * slope
            track.misses, track.last_seen = 0, time
            if length < config.min_length_px:
                track.mark_lost()

    def observed(self) -> list[LineTrack]:
        """All tracks as of the last frame, as plain values, also those that have ended: what they
        saw before still counts.
        """
        return [
            LineTrack(track.id, track.first_time, track.misses == 0, track.sightings)
            for track in (*self.tracks, *self._ended)
        ]

    def reject(self, ids: Collection[int]) -> None:
        """Follow these tracks no longer, and forget what they saw."""
        for track in (*self.tracks, *self._ended):
            if track.id in ids:
                track.mark_lost()
                track.sightings = deque()

    def drop_lost(self) -> None:
        """End the tracks that are lost."""
        self._ended += [track for track in self.tracks if track.lost]
        self.tracks = [track for track in self.tracks if not track.lost]

    def clear(self) -> None:
        """Forget all tracks."""
        self.tracks.clear()
        self._ended.clear()

    def retime(self, change: float) -> None:
        """The times of all frames were corrected by so much, s."""
        self._time += change
        for track in (*self.tracks, *self._ended):
            track.first_time, track.last_seen = track.first_time + change, track.last_seen + change

    def forget(self, before: int) -> None:
        """Drop sightings in frames before a stamp, and ended tracks without others."""
        for track in (*self.tracks, *self._ended):
            while track.sightings and track.sightings[0].stamp < before:
                track.sightings.popleft()
        self._ended = [track for track in self._ended if track.sightings]

    def drop_duplicates(self) -> None:
        """Of tracks that have come to follow the same line forget all but the oldest."""
        tracks = sorted(self.tracks, key=lambda track: track.first_time)
        own = LineSegments.of(tracks)
        same = duplicates(own, own, self.camera.focal_length, self._config)
        self.tracks = [tracks[i] for i in first_of_duplicates(same)]

    def lines_moved(self, since: int) -> tuple[FloatArray, FloatArray]:
        """Of the lines seen in a frame and now: where they were then, image lines (N, 3),
        normalised coordinates, and how far each has moved across itself, (N,), px.
        """
        lines, moved = moved_since([track for track in self.tracks if track.misses == 0], since)
        return lines, moved * self.camera.focal_length

    def start_new(
        self,
        stamp: int,
        time: float,
        segments: FloatArray,
        gradient: Gradient,
        rows: RowMotion | None = None,
    ) -> None:
        """Start tracks on segments (N, 2, 2), in px, until there are enough; `rows` is of a rolling
        shutter.
        """
        if len(self.tracks) < self._edges.max_lines:
            started, edges = self.starter.start(time, segments, gradient, self.tracks, rows)
            self._sight(stamp, started, edges)
            expect_motion(started, self.tracks, self._elapsed, self.camera, self._config)
            self.tracks += started
