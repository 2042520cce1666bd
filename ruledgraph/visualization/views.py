# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What pictures show of a frame: plain values, taken from the odometry in this one place."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.measurements import Frame
from ruledgraph.frontend.track import Track
from ruledgraph.odometry import Odometry

# Without a single line in view nothing says which frames were processed; more than this many do
# not wait.
_MAX_WAITING = 8
# A ruling is a curve in a distorted image.
_CURVE_POINTS = 20


@dataclass(frozen=True, eq=False)
class ViewedLine:
    """A line found in a frame."""

    id: int
    ends: FloatArray
    """Of its ruling, normalised image coordinates, (2, 2)."""
    points: FloatArray
    """Edge points, normalised image coordinates, (N, 2)."""
    in_graph: bool
    """Whether it is a variable of the graph, not only a track."""

    def curve(self, camera: CameraModel) -> FloatArray:
        """The ruling in the image as it was taken, with distortion, px, (20, 2)."""
        along = np.linspace(0.0, 1.0, _CURVE_POINTS)[:, None]
        return camera.distort(self.ends[0] + along * (self.ends[1] - self.ends[0])).pixels

    def pixels(self, camera: CameraModel) -> FloatArray:
        """The edge points in the image as it was taken, px, (N, 2)."""
        return camera.distort(self.points).pixels


@dataclass(frozen=True, eq=False)
class View:
    """A frame that has been processed, and the lines found in it."""

    frame: Frame
    lines: tuple[ViewedLine, ...]
    status: str
    """Of the odometry, without the reason for it."""
    since_start: float
    """Time since the first frame, s."""


class ViewQueue:
    """Holds frames until the odometry has processed them, for which it waits for the IMU.

    When a frame has just been added, the tracks are those of the frame before, without the ones
    that will only be started there.
    """

    def __init__(self) -> None:
        self._waiting: deque[Frame] = deque()
        self._first: int | None = None

    def take(self, odometry: Odometry, added: Frame) -> list[View]:
        """The frames processed since the last call; `added` is the one just added."""
        self._waiting.append(added)
        self._first = added.stamp if self._first is None else self._first
        newest = max(
            (t.sightings[-1].stamp for t in odometry.tracker.tracks if t.sightings), default=-1
        )
        taken = []
        while self._waiting and (
            self._waiting[0].stamp <= newest or len(self._waiting) > _MAX_WAITING
        ):
            frame = self._waiting.popleft()
            taken.append(_view(odometry, frame, (frame.stamp - self._first) * 1e-9))
        return taken


def _view(odometry: Odometry, frame: Frame, since_start: float) -> View:
    window = odometry.window
    in_graph = window.lines if window is not None else {}
    lines = []
    for track in odometry.tracker.tracks:
        seen = next((s for s in reversed(track.sightings) if s.stamp <= frame.stamp), None)
        if seen is not None and seen.stamp == frame.stamp:
            ends = _as_calibrated(_ends(track, seen.points, frame.stamp), odometry)
            points = _as_calibrated(seen.points, odometry)
            lines.append(ViewedLine(track.id, ends, points, track.id in in_graph))
    status, _, _ = odometry.status.partition(":")
    return View(frame, tuple(lines), status, since_start)


def _as_calibrated(points: FloatArray, odometry: Odometry) -> FloatArray:
    """Normalised by the calibration's camera, not by the one that is found while running."""
    given, found = odometry.calibration.camera, odometry.tracker.camera
    return points if found is given else given.undistort(found.distort(points).pixels)


def _ends(track: Track, points: FloatArray, stamp: int) -> FloatArray:
    """Of the ruling in a frame: the track's own in the last one, else the outermost points."""
    last = track.sightings[-1].stamp == stamp and track.misses == 0
    return track.ends if last else points[[0, -1]]
