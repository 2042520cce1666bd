# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in the image: where each was seen, and following them from frame to frame.

A track is followed by its ruling alone. While nothing is known of its depth its next ruling is
predicted from the gyroscope's rotation and its own motion across itself; once it is in the graph,
from the estimate.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ruledgraph.config import EdgesConfig
from ruledgraph.edges.detect import Detector
from ruledgraph.edges.gradient import Gradient
from ruledgraph.edges.search import EdgePoints, Ruling, normal_of, search, search_all
from ruledgraph.sensors import CameraModel, FloatArray

# Deviation of a prediction across the ruling, px: of a fresh track, at least, at most.
_FRESH_SIGMA, _LEAST_SIGMA, _MOST_SIGMA = 4.0, 1.2, 6.0
# A track that was not found in so many frames or for so long (s) is lost.
_MOST_MISSES, _LONGEST_MISS = 3, 0.12
# How far past its ends a line is searched, as a share of its length, so that it can grow.
_BEYOND = 0.06
# Points this far off a straight line (root mean square, px) are not one line's.
_STRAIGHT = 0.45
# Two lines closer than this all along, px, and within 8 degrees are one.
_TWIN = 5.0
_PARALLEL = 0.99
# A segment shorter than this is lost, px.
_SHORTEST = 25.0
# Fewer lines say nothing of whether the image moves.
_FEWEST_MOVING = 3


@dataclass(frozen=True, eq=False)
class Sighting:
    """The edge points (N, 2), normalised, of a line in one frame."""

    stamp: int
    points: FloatArray


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
    rates: FloatArray = field(default_factory=lambda: np.zeros(2))
    """Motion across itself beside the rotation's, at both ends, px/s."""
    sigma: float = _FRESH_SIGMA
    misses: int = 0
    last_seen: float = 0.0

    @property
    def lost(self) -> bool:
        """Whether it has not been found for too long."""
        return self.misses > _MOST_MISSES

    def give_up(self) -> None:
        """Make it lost."""
        self.misses = _MOST_MISSES + 1

    def predict_by_rotation(self, cam_R_before: FloatArray, elapsed: float, focal: float) -> Ruling:
        """The ruling in a frame whose camera turned by `cam_R_before` since the last one."""
        rays = np.column_stack([self.ends, np.ones(2)]) @ cam_R_before.T
        ends = rays[:, :2] / rays[:, 2:]
        ends = ends + (self.rates * elapsed / focal)[:, None] * normal_of(ends)
        return Ruling(ends, (self.sigma, self.sigma), self.slope)


class Tracker:
    """Follows tracks through frames and starts new ones."""

    def __init__(self, camera: CameraModel, config: EdgesConfig, detect: Detector) -> None:
        self.tracks: list[Track] = []
        self._camera = camera
        self._config = config
        self._detect = detect
        self._next = 0
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
        rim = np.concatenate([corners, [[0.5, 0.0], [0.5, 1.0], [0.0, 0.5], [1.0, 0.5]]])
        seen = camera.undistort(rim * [camera.width - 1, camera.height - 1])
        self._low, self._high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)

    def follow(
        self, stamp: int, time: float, gradient: Gradient, rulings: Sequence[Ruling]
    ) -> list[EdgePoints | None]:
        """Look for every track where it is predicted, one ruling for each of `tracks`; update them.

        What was found of each, None if nothing.
        """
        visible: list[tuple[Track, Ruling]] = []
        for track, ruling in zip(self.tracks, rulings, strict=True):
            ends = self._clip(ruling.ends)
            if ends is None:
                track.give_up()
            else:
                visible.append((track, ruling._replace(ends=ends)))
        beyond = _BEYOND if self._config.bounded else 10.0
        searched = search_all(gradient, self._camera, [ruling for _, ruling in visible], beyond)
        found: dict[int, EdgePoints | None] = {}
        for (track, ruling), points in zip(visible, searched, strict=True):
            found[track.number] = self._update(stamp, time, track, ruling.ends, points)
        return [found.get(track.number) for track in self.tracks]

    def _update(
        self, stamp: int, time: float, track: Track, ends: FloatArray, found: EdgePoints | None
    ) -> EdgePoints | None:
        """Take in what the search between `ends` found; None if it is not good enough."""
        if found is None or found.ambiguous or found.deviation > _STRAIGHT:
            track.ends = ends
            track.misses += 1
            if time - track.last_seen > _LONGEST_MISS:
                track.misses = max(track.misses, _MOST_MISSES)
            track.sigma = min(1.5 * track.sigma, _MOST_SIGMA)
            return None
        a, b = found.line
        offsets = np.array([a, a + b])
        gain = 0.7 if track.misses == 0 else 0.3
        track.rates = track.rates + gain * offsets / max(time - track.last_seen, 1e-3)
        track.sigma = max(_LEAST_SIGMA + 0.8, 0.7 * track.sigma)
        track.ends = _extent(ends, found)
        track.slope = 0.8 * track.slope + 0.2 * found.slope
        track.misses = 0
        track.last_seen = time
        track.sightings.append(Sighting(stamp, found.points))
        if self._length(track.ends) < _SHORTEST:
            track.give_up()
        return found

    def drop_lost(self) -> list[Track]:
        """Forget the tracks that are lost, and the younger of twins; returns them."""
        keep: list[Track] = []
        gone = [track for track in self.tracks if track.lost]
        for track in sorted((t for t in self.tracks if not t.lost), key=lambda t: t.born):
            if self._has_twin(track.ends, track.slope, keep):
                gone.append(track)
            else:
                keep.append(track)
        self.tracks = keep
        return gone

    def image_motion(self, since: int) -> float:
        """Median distance that lines moved across themselves since a frame, px; inf if too few
        were seen in it and now.
        """
        moved = []
        for track in self.tracks:
            then = [s for s in track.sightings if s.stamp == since]
            if then and track.misses == 0:
                old, new = then[0].points, track.sightings[-1].points
                normal = normal_of(old[[0, -1]])
                moved.append(abs(float((new.mean(axis=0) - old.mean(axis=0)) @ normal)))
        few = len(moved) < _FEWEST_MOVING
        return np.inf if few else float(np.median(moved)) * self._camera.focal_length

    def start_new(
        self, stamp: int, time: float, image: NDArray[np.uint8], gradient: Gradient
    ) -> None:
        """Start tracks on detected segments until there are enough."""
        wanted = self._config.max_lines - len(self.tracks)
        if wanted <= 0:
            return
        segments = self._detect(image)
        lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        long = lengths > self._config.min_length
        segments, lengths = segments[long], lengths[long]
        crowd = self._crowding(segments)
        for i in np.argsort(-lengths / crowd):
            if wanted <= 0:
                break
            track = self._start(stamp, time, segments[i], gradient)
            if track is not None:
                self.tracks.append(track)
                wanted -= 1

    def _start(
        self, stamp: int, time: float, segment: FloatArray, gradient: Gradient
    ) -> Track | None:
        ends = self._camera.undistort(segment)
        if not np.all(np.isfinite(ends)):
            return None
        direction = (segment[1] - segment[0]) / np.linalg.norm(segment[1] - segment[0])
        across = np.array([-direction[1], direction[0]])
        stations = segment[0] + np.linspace(0.1, 0.9, 15)[:, None] * (segment[1] - segment[0])
        slope = float(np.median(gradient.along(stations, across[None])))
        if self._has_twin(ends, slope, self.tracks):
            return None
        found = search(gradient, self._camera, Ruling(ends, (1.0, 1.0), slope))
        if found is None or found.deviation > _STRAIGHT or found.support < 0.6:
            return None
        self._next += 1
        return Track(
            number=self._next,
            born=time,
            ends=_extent(ends, found),
            slope=found.slope,
            sightings=deque([Sighting(stamp, found.points)]),
            last_seen=time,
        )

    def _crowding(self, segments: FloatArray) -> FloatArray:
        """1 for a direction and place without tracks, more where there are some already."""
        if not self.tracks or not len(segments):
            return np.ones(len(segments))
        size = np.array([self._camera.width, self._camera.height])
        own = self._camera.distort(np.concatenate([t.ends for t in self.tracks])).pixels
        own = own.reshape(-1, 2, 2)
        near = np.linalg.norm(
            (segments.mean(axis=1)[:, None] - own.mean(axis=1)[None]) / size, axis=2
        )
        return np.asarray(1.0 + 2.0 * np.sum(np.exp(-((near / 0.12) ** 2)), axis=1))

    def _has_twin(self, ends: FloatArray, slope: float, tracks: Sequence[Track]) -> bool:
        normal = normal_of(ends)
        middle = ends.mean(axis=0)
        for track in tracks:
            other = normal_of(track.ends)
            same = float(np.sign(slope * track.slope) * (normal @ other))
            if same < _PARALLEL:
                continue
            gap = np.abs((ends - track.ends[0]) @ other) * self._camera.focal_length
            along = track.ends[1] - track.ends[0]
            place = (np.vstack([ends, middle]) - track.ends[0]) @ along / (along @ along)
            overlaps = place.max() > -0.2 and place.min() < 1.2
            if np.all(gap < _TWIN) and overlaps:
                return True
        return False

    def _length(self, ends: FloatArray) -> float:
        pixels = self._camera.distort(ends).pixels
        return float(np.linalg.norm(pixels[1] - pixels[0]))

    def _clip(self, ends: FloatArray) -> FloatArray | None:
        """The part of a segment inside the field of view."""
        start, along = ends[0], ends[1] - ends[0]
        first, last = 0.0, 1.0
        for axis in range(2):
            if abs(along[axis]) < 1e-12:
                if not self._low[axis] <= start[axis] <= self._high[axis]:
                    return None
                continue
            a = (self._low[axis] - start[axis]) / along[axis]
            b = (self._high[axis] - start[axis]) / along[axis]
            first, last = max(first, min(a, b)), min(last, max(a, b))
        if last - first <= 1e-6:
            return None
        return np.stack([start + first * along, start + last * along])


def _extent(ends: FloatArray, found: EdgePoints) -> FloatArray:
    """The segment's ends moved onto the line through its points, and towards the outermost ones."""
    middle = found.points.mean(axis=0)
    _, _, axes = np.linalg.svd(found.points - middle, full_matrices=False)
    direction = axes[0] if axes[0] @ (ends[1] - ends[0]) > 0.0 else -axes[0]
    predicted = (ends - middle) @ direction
    reached = np.sort((found.points - middle) @ direction)
    # One stray point does not stretch it.
    seen = np.array([reached[1], reached[-2]])
    return np.asarray(middle + (predicted + 0.3 * (seen - predicted))[:, None] * direction)
