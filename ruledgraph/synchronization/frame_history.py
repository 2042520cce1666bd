# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The times of the latest frames, on the IMU's clock."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from ruledgraph.core.measurements import STAMP_JITTER
from ruledgraph.imu.buffer import ImuBuffer

TIME_TOLERANCE = STAMP_JITTER * 1e-9
"""Frames at intervals are on time when they come this much early, s."""


class FrameTime(NamedTuple):
    """A frame that was processed."""

    stamp: int
    """ns; identifies the frame."""
    time: float
    """s, on the IMU's clock."""


class FrameHistory:
    """The frames that were processed, in order of time, as far back as they are kept."""

    def __init__(self) -> None:
        self._frames: deque[FrameTime] = deque()

    def __bool__(self) -> bool:
        return bool(self._frames)

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[FrameTime]:
        return iter(self._frames)

    @property
    def first(self) -> FrameTime:
        """The earliest that is kept."""
        return self._frames[0]

    @property
    def last(self) -> FrameTime:
        """The latest."""
        return self._frames[-1]

    def append(self, frame: FrameTime) -> None:
        """Add one that is later than all."""
        self._frames.append(frame)

    def after(self, time: float) -> list[FrameTime]:
        """Those later than a time, s."""
        return [frame for frame in self._frames if frame.time > time]

    def since(self, time: float) -> list[FrameTime]:
        """Those from about a time (s) on."""
        return [frame for frame in self._frames if frame.time >= time - TIME_TOLERANCE]

    def at(self, time: float) -> FrameTime | None:
        """The last one until about a time, s."""
        before = [frame for frame in self._frames if frame.time <= time + TIME_TOLERANCE]
        return before[-1] if before else None

    def retime(self, change: float, imu: ImuBuffer) -> None:
        """Correct all times by so much (s) and drop frames that are before the samples then."""
        moved = (frame._replace(time=frame.time + change) for frame in self._frames)
        self._frames = deque(f for f in moved if imu.covers(f.time, imu.latest))

    def forget(self, before: float) -> None:
        """Drop frames before a time, s."""
        while self._frames and self._frames[0].time < before:
            self._frames.popleft()

    def clear(self) -> None:
        """Drop all."""
        self._frames.clear()
