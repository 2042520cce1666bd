# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""On which segments of an image new tracks start."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import EdgesConfig, TracksConfig
from ruledgraph.frontend.duplicates import duplicates, first_of_duplicates
from ruledgraph.frontend.edge_batch import Edges, Rulings, search_all
from ruledgraph.frontend.field_of_view import within_reach
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.rolling_edges import keep_unsettled, straight_edges
from ruledgraph.frontend.row_motion import MovingRulings, RowMotion, StraightPoints
from ruledgraph.frontend.track import LineSegments, Track


class TrackStarter:
    """Starts tracks where no line is followed yet.

    Args:
        camera: the calibrated camera.
        edges: settings of edge points.
        config: settings of tracks.
        max_rms: the most that edge points may deviate from a line, px.
    """

    def __init__(
        self, camera: CameraModel, edges: EdgesConfig, config: TracksConfig, max_rms: float
    ) -> None:
        self.camera = camera
        """That points are undistorted by."""
        self._edges = edges
        self._config = config
        self._max_rms = max_rms
        self._started = 0

    def start(
        self,
        time: float,
        segments: FloatArray,
        gradient: Gradient,
        tracks: Sequence[Track],
        rows: RowMotion | None = None,
    ) -> tuple[list[Track], Edges]:
        """New tracks beside those that are followed, until there are enough.

        Args:
            time: of the frame, s.
            segments: found in it, (N, 2, 2), px.
            gradient: of the frame.
            tracks: that are followed already.
            rows: of a rolling shutter.

        Returns:
            The tracks and the edge points of each.
        """
        own = LineSegments.of(tracks)
        candidates = self._candidates(segments, gradient, own, rows)
        searched, moving = candidates, None
        if rows is not None:
            # Of the translation nothing is known yet.
            moving = MovingRulings(rows, candidates.ends, np.zeros_like(candidates.ends))
            bent, bows = moving.bent()
            searched = candidates._replace(ends=bent, bows=bows)
        edges = search_all(gradient, self.camera, searched, config=self._edges)
        # Seen well enough to be followed.
        full = (
            (edges.counts > 0)
            & (edges.rms_px <= self._max_rms)
            & (edges.support >= self._config.start_support)
        )
        edges, points = edges.part(full), list[StraightPoints]()
        if moving is not None:
            moving = moving.part(full)
            edges, points = straight_edges(edges, moving, self._edges.end_growth)
        found = LineSegments(edges.ends, edges.slopes)
        new = np.flatnonzero(~np.any(self._duplicates(found, own), axis=1))
        # Two candidates may be one line as well.
        found = LineSegments(edges.ends[new], edges.slopes[new])
        wanted = self._edges.max_lines - len(tracks)
        chosen = new[first_of_duplicates(self._duplicates(found, found))[:wanted]]
        kept = np.zeros(len(edges.ends), dtype=bool)
        kept[chosen] = True
        edges = edges.part(kept)
        started = [
            self._new_track(time, ends, slope)
            for ends, slope in zip(edges.ends, edges.slopes.tolist(), strict=True)
        ]
        if moving is not None:
            keep_unsettled(started, [points[i] for i in np.flatnonzero(kept)], moving.part(kept))
        return started, edges

    def _new_track(self, time: float, ends: FloatArray, slope: float) -> Track:
        self._started += 1
        return Track(
            id=self._started,
            first_time=time,
            ends=ends,
            slope=slope,
            sigma=self._config.fresh_sigma_px,
            last_seen=time,
            config=self._config,
        )

    def _candidates(
        self, segments: FloatArray, gradient: Gradient, own: LineSegments, rows: RowMotion | None
    ) -> Rulings:
        """Segments that are long enough and not followed yet, those worth most first."""
        along = segments[:, 1] - segments[:, 0]
        segments = segments[np.hypot(along[:, 0], along[:, 1]) > self._config.min_length_px]
        ends = self.camera.undistort(segments.reshape(-1, 2)).reshape(-1, 2, 2)
        seen = within_reach(ends).all(axis=1)
        segments, ends = segments[seen], ends[seen]
        if rows is not None:
            exposed = rows.row_times(ends.reshape(-1, 2))
            ends = rows.derotated(ends.reshape(-1, 2), exposed).reshape(-1, 2, 2)
        along = segments[:, 1] - segments[:, 0]
        lengths = np.hypot(along[:, 0], along[:, 1])
        across = np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths[:, None]
        stations = segments[:, :1] + np.linspace(0.1, 0.9, 15)[:, None] * along[:, None]
        slopes = np.median(gradient.along(stations, across[:, None]), axis=1).astype(np.float64)
        new = ~np.any(self._duplicates(LineSegments(ends, slopes), own), axis=1)
        order = np.argsort(-lengths / self._crowding(segments, own))
        return Rulings(ends, np.ones((len(ends), 2)), slopes).part(order[new[order]])

    def _crowding(self, segments: FloatArray, own: LineSegments) -> FloatArray:
        """1 at a position without tracks, more where there are some already."""
        if not len(own.ends) or not len(segments):
            return np.ones(len(segments))
        size = np.array([self.camera.width, self.camera.height])
        pixels = self.camera.distort(own.ends.reshape(-1, 2)).pixels.reshape(-1, 2, 2)
        near = np.linalg.norm(
            (segments.mean(axis=1)[:, None] - pixels.mean(axis=1)[None]) / size, axis=2
        )
        near = np.exp(-((near / self._config.crowding_radius) ** 2))
        return np.asarray(1.0 + self._config.crowding_weight * np.sum(near, axis=1))

    def _duplicates(self, segments: LineSegments, own: LineSegments) -> NDArray[np.bool_]:
        return duplicates(segments, own, self.camera.focal_length, self._config)
