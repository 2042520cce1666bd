# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The front end: an image in, the edge points of the lines it follows out."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import EdgesConfig, TracksConfig
from ruledgraph.core.line_observations import LineTrack, PluckerEstimate
from ruledgraph.core.measurements import Frame
from ruledgraph.core.timing import Timings
from ruledgraph.frontend.detection import Detection
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.line_detection import DETECTORS
from ruledgraph.frontend.prefetch import PrefetchCache
from ruledgraph.frontend.rolling_edges import row_moves
from ruledgraph.frontend.row_motion import RowMotion
from ruledgraph.frontend.ruling_prediction import CameraMotion, predict
from ruledgraph.frontend.tracker import Tracker

# Gradients, of eight times the memory of an image, are computed of so many frames ahead at most.
_MAX_GRADIENTS = 32


class FramePrediction(NamedTuple):
    """What is known of a frame before it is looked at."""

    motion: CameraMotion
    lines: Mapping[int, PluckerEstimate]
    """Of the graph, by their ids; other tracks are predicted by the rotation alone."""


class FrontEnd:
    """Follows lines from frame to frame and starts new ones.

    For each frame call `start_tracks`, then `process`, then, when all who may `reject` tracks have
    done so, `drop_lost`.
    """

    def __init__(
        self, camera: CameraModel, edges: EdgesConfig, tracks: TracksConfig, timings: Timings
    ) -> None:
        self.tracker = Tracker(camera, edges, tracks)
        self._focal = camera.focal_length
        self._config = tracks
        self._timings = timings
        self._detection = Detection(self.tracker, DETECTORS[edges.detector])
        self._gradients = PrefetchCache[Gradient](_MAX_GRADIENTS)

    def prefetch(self, frame: Frame) -> None:
        """Compute of a frame to come what it will need; from another thread, in order."""
        if not self._gradients.full:
            self._gradients.put(frame, Gradient(frame.image))
        self._detection.prefetch(frame)

    def set_camera(self, camera: CameraModel) -> None:
        """Undistort points by this camera from now on, whose focal length is the same."""
        if camera is not self.tracker.camera:
            self.tracker.set_camera(camera)

    def start_tracks(self) -> None:
        """Start tracks on the segments found in the frame before, if they were looked for."""
        if self._detection.pending:
            with self._timings.measured("detection"):
                self._detection.start_tracks()

    def process(
        self,
        frame: Frame,
        time: float,
        predicted: FramePrediction | None,
        detect_every: float | None,
        rows: RowMotion | None = None,
    ) -> list[int]:
        """Search every track where it is predicted.

        Args:
            frame: the image.
            time: of the frame, s.
            predicted: None for the first frame.
            detect_every: new segments are looked for, too, when that was last done so long ago, s.
            rows: the camera's motion during the image, of a rolling shutter.

        Returns:
            The ids of the tracks that were found.
        """
        with self._timings.measured("gradient"):
            gradient = self._gradients.take(frame) or Gradient(frame.image)
        if detect_every is not None and self._detection.is_due(time, detect_every):
            self._detection.begin(frame, gradient, time, rows)
        if predicted is None:
            return []
        with self._timings.measured("search"):
            lines, motion = predicted.lines, predicted.motion
            rulings = predict(self.tracker.tracks, lines, motion, self._focal, self._config)
            moves = None
            if rows is not None:
                moves = row_moves(self.tracker.tracks, rulings, lines, motion.world_T_cam, rows)
            found = self.tracker.track(frame.stamp, time, gradient, rulings, moves)
        return [track.id for track in found]

    def observed(self) -> list[LineTrack]:
        """The tracks as of the last frame, also those that have ended; see `drop_lost`."""
        return self.tracker.observed()

    def lines_moved(self, since: int) -> tuple[FloatArray, FloatArray]:
        """See `Tracker.lines_moved`."""
        return self.tracker.lines_moved(since)

    def reject(self, ids: Collection[int]) -> None:
        """Follow these tracks no longer, and forget what they saw."""
        self.tracker.reject(ids)

    def drop_lost(self, before: int) -> None:
        """End the tracks that are lost, and forget what was seen before a stamp."""
        self.tracker.drop_lost()
        self.tracker.forget(before)

    def retime(self, change: float) -> None:
        """The times of all frames were corrected by so much, s."""
        self.tracker.retime(change)
        self._detection.retime(change)

    def clear(self) -> None:
        """Forget all tracks."""
        self.tracker.clear()
        self._detection.forget()
