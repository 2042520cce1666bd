# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Looking for segments beside the smoother, and starting tracks on them."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from ruledgraph.edges.detect import Detector
from ruledgraph.edges.gradient import Gradient
from ruledgraph.measurements import Frame
from ruledgraph.sensors import FloatArray
from ruledgraph.tracks import Tracker


class _Search(NamedTuple):
    stamp: int
    time: float
    gradient: Gradient
    segments: Future[FloatArray]


class Detection:
    """New tracks of a frame, which start with the next one.

    The detector works in a thread of its own while the smoother runs on the same frame, whose
    estimate waits for neither.
    """

    def __init__(self, tracker: Tracker, detector: Detector) -> None:
        self._tracker = tracker
        self._detector = detector
        self._worker = ThreadPoolExecutor(1, "detection")
        self._search: _Search | None = None
        self.last = -float("inf")
        """Time of the last frame that was searched, s."""

    def begin(self, frame: Frame, time: float) -> None:
        """Look for segments in a frame, taken at `time` (s)."""
        self.last = time
        segments = self._worker.submit(self._detector, frame.image)
        self._search = _Search(frame.stamp, time, frame.gradient, segments)

    @property
    def pending(self) -> bool:
        """Whether the last frame was searched, and no tracks were started in it yet."""
        return self._search is not None

    def start_tracks(self) -> None:
        """Start tracks on what was found in the last frame."""
        search, self._search = self._search, None
        if search is not None:
            self._tracker.drop_twins()
            segments = search.segments.result()
            self._tracker.start_new(search.stamp, search.time, segments, search.gradient)

    def forget(self) -> None:
        """Start no tracks on what is still looked for."""
        self._search = None
