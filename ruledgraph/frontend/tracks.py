# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in the image: where each was seen, and following them from frame to frame.

A track is followed by its ruling alone. While nothing is known of its depth its next ruling is
predicted from the gyroscope's rotation and its own motion across itself; once it is in the graph,
from the estimate.
"""

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.sensors import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, EdgesConfig, TracksConfig
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph.frontend.edge_batch import Edges, Rulings, clipped, search_all, stacked
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.sobel import search_sobel, sobel_points

# How far past its ends an unbounded line is searched, as a share of its length: across any image.
_UNBOUNDED = 10.0


@dataclass(eq=False)
class Track:
    """A line in the image."""

    number: int
    born: float
    """Time of the first sighting, s."""
    ends: FloatArray
    """In the last frame, (2, 2), normalised."""
    slope: float
    """Usual grey level slope across it, signed."""
    sightings: deque[Sighting] = field(default_factory=deque)
    rates: tuple[float, float] = (0.0, 0.0)
    """Motion across itself beside the rotation's, at both ends, px/s."""
    sigma: float = DEFAULTS.tracks.fresh_sigma_px
    """Of the prediction across the ruling, px."""
    misses: int = 0
    last_seen: float = 0.0
    config: TracksConfig = DEFAULTS.tracks

    @property
    def lost(self) -> bool:
        """Whether it has not been found for too long."""
        return self.misses > self.config.max_misses

    def miss(self, time: float) -> None:
        """Take note that it was not found, s."""
        self.misses += 1
        if time - self.last_seen > self.config.max_miss_time:
            self.misses = max(self.misses, self.config.max_misses)
        self.sigma = min(self.config.sigma_growth * self.sigma, self.config.max_sigma_px)

    def mark_lost(self) -> None:
        """Follow it no longer."""
        self.misses = self.config.max_misses + 1


class Tracker:
    """Follows tracks through frames and starts new ones."""

    def __init__(self, camera: CameraModel, edges: EdgesConfig, config: TracksConfig) -> None:
        self.tracks: list[Track] = []
        self._camera = camera
        self._edges = edges
        self._config = config
        max_rms = {"maxima": config.max_rms_px, "sobel": config.max_rms_sobel_px}
        self._max_rms = max_rms[edges.points]
        self._next = 0
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
        rim = np.concatenate([corners, [[0.5, 0.0], [0.5, 1.0], [0.0, 0.5], [1.0, 0.5]]])
        seen = camera.undistort(rim * [camera.width - 1, camera.height - 1])
        self._low, self._high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)

    def follow(self, stamp: int, time: float, gradient: Gradient, rulings: Rulings) -> list[Track]:
        """Look for every track where it is predicted, a ruling for each of `tracks`; update them.

        Returns:
            Those that were found.
        """
        ends, in_view = clipped(rulings.ends, self._low, self._high)
        edges = self._search(gradient, rulings._replace(ends=ends).part(in_view))
        good = (edges.counts > 0) & ~edges.ambiguous & (edges.deviation <= self._max_rms)
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
            self._move(time, seen, edges)
            self._sight(stamp, seen, edges)
        return seen

    def _search(self, gradient: Gradient, rulings: Rulings) -> Edges:
        if self._edges.points == "sobel":
            edges, gate = sobel_points(gradient.image), self._edges.gate
            found = [search_sobel(edges, self._camera, each, gate) for each in rulings.one_by_one()]
            return stacked(rulings, found)
        beyond = self._config.search_beyond if self._edges.bounded else _UNBOUNDED
        return search_all(gradient, self._camera, rulings, beyond)

    def _sight(self, stamp: int, tracks: Sequence[Track], edges: Edges) -> None:
        # As `GeometricPoints.from_frames` caps what a frame counts for.
        share = np.minimum(1.0, self._edges.effective_points / edges.counts)
        statistics = np.sqrt(share)[:, None, None] * edges.statistics
        for i, (track, points) in enumerate(zip(tracks, edges.points_of_each(), strict=True)):
            track.sightings.append(Sighting(stamp, points, statistics[i]))

    def _move(self, time: float, tracks: Sequence[Track], edges: Edges) -> None:
        """Take tracks to where they were found."""
        along = edges.ends[:, 1] - edges.ends[:, 0]
        lengths = np.hypot(along[:, 0], along[:, 1]) * self._camera.focal_length
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
        """All tracks as of the last frame, as plain values."""
        return [
            LineTrack(track.number, track.born, track.misses == 0, track.sightings)
            for track in self.tracks
        ]

    def mark_lost(self, ids: Collection[int]) -> None:
        """Follow these tracks no longer."""
        for track in self.tracks:
            if track.number in ids:
                track.mark_lost()

    def drop_lost(self) -> None:
        """Forget the tracks that are lost."""
        self.tracks = [track for track in self.tracks if not track.lost]

    def retime(self, change: float) -> None:
        """The times of all frames were corrected by so much, s."""
        for track in self.tracks:
            track.born, track.last_seen = track.born + change, track.last_seen + change

    def forget(self, before: int) -> None:
        """Drop sightings in frames before a stamp."""
        for track in self.tracks:
            while track.sightings and track.sightings[0].stamp < before:
                track.sightings.popleft()

    def drop_duplicates(self) -> None:
        """Of tracks that have come to follow the same line forget all but the oldest."""
        tracks = sorted(self.tracks, key=lambda track: track.born)
        segments = _segments(tracks)
        duplicates = self._duplicates(*segments, *segments)
        self.tracks = [tracks[i] for i in _first_of_duplicates(duplicates)]

    def image_motion(self, since: int, min_lines: int = 1) -> float:
        """Median distance that lines moved across themselves since a frame, px; inf if fewer than
        `min_lines` were seen in it and now.
        """
        moved = []
        for track in self.tracks:
            then = next((s for s in reversed(track.sightings) if s.stamp <= since), None)
            if then is not None and then.stamp == since and track.misses == 0:
                old, new = then.points, track.sightings[-1].points
                normal = normal_of(old[[0, -1]])
                moved.append(abs(float((new.mean(axis=0) - old.mean(axis=0)) @ normal)))
        few = len(moved) < min_lines
        return np.inf if few else float(np.median(moved)) * self._camera.focal_length

    def start_new(self, stamp: int, time: float, segments: FloatArray, gradient: Gradient) -> None:
        """Start tracks on segments (N, 2, 2), in px, until there are enough."""
        wanted = self._edges.max_lines - len(self.tracks)
        if wanted <= 0:
            return
        rulings = self._candidates(segments, gradient)
        edges = search_all(gradient, self._camera, rulings)
        # Seen well enough to be followed.
        full = (
            (edges.counts > 0)
            & (edges.deviation <= self._max_rms)
            & (edges.support >= self._config.start_support)
        )
        edges = edges.part(full)
        duplicates = self._duplicates(edges.ends, edges.slopes, *_segments(self.tracks))
        edges = edges.part(~np.any(duplicates, axis=1))
        # Two candidates may be one line as well.
        duplicates = self._duplicates(edges.ends, edges.slopes, edges.ends, edges.slopes)
        kept = np.zeros(len(duplicates), dtype=bool)
        kept[_first_of_duplicates(duplicates)[:wanted]] = True
        edges = edges.part(kept)
        started = []
        for ends, slope in zip(edges.ends, edges.slopes.tolist(), strict=True):
            self._next += 1
            sigma = self._config.fresh_sigma_px
            track = Track(self._next, time, ends, slope, sigma=sigma, config=self._config)
            track.last_seen = time
            started.append(track)
        self._sight(stamp, started, edges)
        self.tracks += started

    def _candidates(self, segments: FloatArray, gradient: Gradient) -> Rulings:
        """Segments that are long enough and not followed yet, those worth most first."""
        along = segments[:, 1] - segments[:, 0]
        segments = segments[np.hypot(along[:, 0], along[:, 1]) > self._edges.min_length]
        ends = self._camera.undistort(segments.reshape(-1, 2)).reshape(-1, 2, 2)
        seen = np.isfinite(ends).all(axis=(1, 2))
        segments, ends = segments[seen], ends[seen]
        along = segments[:, 1] - segments[:, 0]
        lengths = np.hypot(along[:, 0], along[:, 1])
        across = np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths[:, None]
        stations = segments[:, :1] + np.linspace(0.1, 0.9, 15)[:, None] * along[:, None]
        slopes = np.median(gradient.along(stations, across[:, None]), axis=1).astype(np.float64)
        new = ~np.any(self._duplicates(ends, slopes, *_segments(self.tracks)), axis=1)
        order = np.argsort(-lengths / self._crowding(segments))
        return Rulings(ends, np.ones((len(ends), 2)), slopes).part(order[new[order]])

    def _crowding(self, segments: FloatArray) -> FloatArray:
        """1 for a direction and place without tracks, more where there are some already."""
        if not self.tracks or not len(segments):
            return np.ones(len(segments))
        size = np.array([self._camera.width, self._camera.height])
        own = self._in_pixels(self.tracks)
        near = np.linalg.norm(
            (segments.mean(axis=1)[:, None] - own.mean(axis=1)[None]) / size, axis=2
        )
        near = np.exp(-((near / self._config.crowding_radius) ** 2))
        return np.asarray(1.0 + self._config.crowding_weight * np.sum(near, axis=1))

    def _duplicates(
        self,
        ends: FloatArray,
        slopes: FloatArray,
        own_ends: FloatArray,
        own_slopes: FloatArray,
    ) -> NDArray[np.bool_]:
        """Which of M segments with slopes are the same line as which of N own ones, (M, N)."""
        config = self._config
        normals, along = normal_of(own_ends), own_ends[:, 1] - own_ends[:, 0]
        same = np.sign(slopes[:, None] * own_slopes) * (normal_of(ends) @ normals.T)
        three = np.concatenate([ends, ends.mean(axis=1, keepdims=True)], axis=1)
        # Both (M, 3, N), counted from the own ones' first ends.
        gap = np.abs(three @ normals.T - np.sum(own_ends[:, 0] * normals, axis=1))
        place = three @ along.T - np.sum(own_ends[:, 0] * along, axis=1)
        place /= np.sum(along**2, axis=1)
        near = np.all(gap * self._camera.focal_length < config.duplicate_distance_px, axis=1)
        overlap = (place.max(axis=1) > -config.duplicate_gap) & (
            place.min(axis=1) < 1.0 + config.duplicate_gap
        )
        return np.asarray((same >= config.duplicate_cosine) & near & overlap)

    def _in_pixels(self, tracks: Sequence[Track]) -> FloatArray:
        """The ends of tracks in the image, (N, 2, 2)."""
        ends, _ = _segments(tracks)
        return self._camera.distort(ends.reshape(-1, 2)).pixels.reshape(-1, 2, 2)


def _first_of_duplicates(duplicates: NDArray[np.bool_]) -> list[int]:
    """Which lines to keep so that no two of them are duplicates, (N, N), an earlier one rather."""
    keep: list[int] = []
    for i in range(len(duplicates)):
        if not duplicates[i, keep].any():
            keep.append(i)
    return keep


def _segments(tracks: Sequence[Track]) -> tuple[FloatArray, FloatArray]:
    """Ends (N, 2, 2) and slopes (N,)."""
    ends = np.array([track.ends for track in tracks]).reshape(-1, 2, 2)
    return ends, np.array([track.slope for track in tracks])
