# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Looking for segments beside the smoother, and starting tracks on them."""

import math
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.measurements import STAMP_JITTER, Frame
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.line_detection import Detector
from ruledgraph.frontend.prefetch import PrefetchCache
from ruledgraph.frontend.row_motion import RowMotion
from ruledgraph.frontend.tracker import Tracker

# No more frames than this are searched ahead, to bound the memory.
_MAX_PREFETCHED = 8


class _Schedule(NamedTuple):
    """When frames are searched, ns."""

    last: int
    interval: int


class _Search(NamedTuple):
    stamp: int
    gradient: Gradient
    time: float
    segments: Future[FloatArray]
    rows: RowMotion | None


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
        self._schedule: _Schedule | None = None
        self._prefetched = PrefetchCache[Future[FloatArray]](_MAX_PREFETCHED, Future.cancel)
        self._seen = 0

    def is_due(self, time: float, every: float) -> bool:
        """Whether the last search was so long before a time, both s."""
        return time - self._last >= every

    def begin(
        self, frame: Frame, gradient: Gradient, time: float, rows: RowMotion | None = None
    ) -> None:
        """Look for segments in a frame with its gradient, taken at `time` (s); `rows` is of a
        rolling shutter.
        """
        self._last = time
        segments = self._prefetched.take(frame) or self._submitted(frame)
        last = self._schedule.last if self._schedule is not None else frame.stamp
        self._schedule = _Schedule(frame.stamp, frame.stamp - last)
        self._search = _Search(frame.stamp, gradient, time, segments, rows)

    def prefetch(self, frame: Frame) -> None:
        """Look for segments in a frame to come, if it is due by the interval of past searches.

        For the thread that reads ahead, each frame in order. It saves waiting, and changes nothing
        else: what is not used is thrown away.
        """
        before, self._seen = self._seen, frame.stamp
        schedule = self._schedule
        if schedule is None or schedule.interval <= 0 or self._prefetched.full:
            return
        periods, periods_before = (
            (stamp - schedule.last + STAMP_JITTER) // schedule.interval
            for stamp in (frame.stamp, before)
        )
        if periods > max(periods_before, 0):
            self._prefetched.put(frame, self._submitted(frame))

    def _submitted(self, frame: Frame) -> Future[FloatArray]:
        return self._worker.submit(self._detector, frame.image)

    @property
    def pending(self) -> bool:
        """Whether a frame was searched in which no tracks were started yet."""
        return self._search is not None

    def start_tracks(self) -> None:
        """Start tracks in the frame that was searched, if there is one."""
        search, self._search = self._search, None
        if search is not None:
            self._tracker.drop_lost()
            self._tracker.drop_duplicates()
            segments = search.segments.result()
            self._tracker.start_new(
                search.stamp, search.time, segments, search.gradient, search.rows
            )

    def retime(self, change: float) -> None:
        """The clock of the frames was corrected by so much, s."""
        self._last += change
        if self._search is not None:
            self._search = self._search._replace(time=self._search.time + change)

    def forget(self) -> None:
        """Start no tracks in the frame that was searched; the next one is searched."""
        if self._search is not None:
            self._search.segments.cancel()
        self._search, self._last = None, -math.inf
