# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Looking for segments beside the smoother, and starting tracks on them."""

import math
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from ruledgraph.edges.detect import Detector
from ruledgraph.measurements import Frame
from ruledgraph.sensors import FloatArray
from ruledgraph.tracks import Tracker


class _Search(NamedTuple):
    frame: Frame
    time: float
    segments: Future[FloatArray]


class Detection:
    """Finds segments in a frame and starts tracks there before the next one.

    The detector works in a thread of its own, while the smoother runs: the estimate of the frame
    does not wait for it. What goes wrong there is raised when the tracks are to start.
    """

    def __init__(self, tracker: Tracker, detector: Detector) -> None:
        self._tracker = tracker
        self._detector = detector
        self._worker = ThreadPoolExecutor(1, "detection")
        self._search: _Search | None = None
        self._last = -math.inf

    def is_due(self, time: float, every: float) -> bool:
        """Whether the last search was so long before a time, both s."""
        return time - self._last >= every

    def begin(self, frame: Frame, time: float) -> None:
        """Look for segments in a frame, taken at `time` (s)."""
        self._last = time
        self._search = _Search(frame, time, self._worker.submit(self._detector, frame.image))

    @property
    def pending(self) -> bool:
        """Whether a frame was searched in which no tracks were started yet."""
        return self._search is not None

    def start_tracks(self) -> None:
        """Start tracks in the frame that was searched, if there is one."""
        search, self._search = self._search, None
        if search is not None:
            self._tracker.drop_lost()
            self._tracker.drop_twins()
            frame, segments = search.frame, search.segments.result()
            self._tracker.start_new(frame.stamp, search.time, segments, frame.gradient)

    def move(self, change: float) -> None:
        """The clock of the frames was corrected by so much, s."""
        self._last += change
        if self._search is not None:
            self._search = self._search._replace(time=self._search.time + change)

    def forget(self) -> None:
        """Start no tracks in the frame that was searched."""
        if self._search is not None:
            self._search.segments.cancel()
        self._search = None
