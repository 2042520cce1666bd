# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of two sensors between the threads that deliver them and the one that works."""

import threading
from collections import deque
from enum import Enum, auto

from ruledgraph.core.measurements import Frame, ImuSample

# IMU samples wait for frames so long at most, ns of their stamps.
_IMU_KEPT = 5 * 10**9
# The IMU may run ahead of the newest frame by so much, ns: more than the frame needs.
_AHEAD = 100_000_000
_NEVER = -(2**63)


class Signal(Enum):
    """What is not a measurement."""

    RESET = auto()
    END = auto()


class SensorQueue:
    """Puts two streams in order of time, in bounded memory whichever of them stops.

    A frame leaves when the IMU has reached it, and IMU samples as long as frames follow. When the
    frames that wait are too many, the oldest is dropped. `put_imu`, `put_frame`, `reset` and `end`
    may be called from any thread and do not wait for the work; `take` from one thread.

    Args:
        frame_shift: time of a frame on the IMU's clock minus its stamp, ns.
        max_frames: that wait.
    """

    def __init__(self, frame_shift: int, max_frames: int) -> None:
        self.dropped_frames = 0
        self.dropped_imu = 0
        self._shift = frame_shift
        self._max_frames = max_frames
        self._changed = threading.Condition()
        self._imu: deque[ImuSample] = deque()
        self._frames: deque[Frame] = deque()
        self._latest_imu = self._latest_frame = _NEVER
        self._reset = self.ended = False

    def __len__(self) -> int:
        """Frames that wait."""
        return len(self._frames)

    def put_imu(self, sample: ImuSample) -> bool:
        """Append a sample; returns whether none had to be dropped for it."""
        with self._changed:
            self._imu.append(sample)
            self._latest_imu = sample.stamp
            before = self.dropped_imu
            while self._imu[0].stamp < sample.stamp - _IMU_KEPT:
                self._imu.popleft()
                self.dropped_imu += 1
            self._changed.notify()
            return self.dropped_imu == before

    def put_frame(self, frame: Frame) -> bool:
        """Append a frame; returns whether none had to be dropped for it."""
        with self._changed:
            self._frames.append(frame)
            self._latest_frame = frame.stamp + self._shift
            fits = len(self._frames) <= self._max_frames
            if not fits:
                self._frames.popleft()
                self.dropped_frames += 1
            self._changed.notify()
            return fits

    def reset(self) -> None:
        """Throw away what waits; `Signal.RESET` is taken next."""
        with self._changed:
            self._imu.clear()
            self._frames.clear()
            self._latest_imu = self._latest_frame = _NEVER
            self.dropped_frames = self.dropped_imu = 0
            self._reset = True
            self._changed.notify()

    def end(self) -> None:
        """No more is put in; what waits is taken, then `Signal.END` for ever."""
        with self._changed:
            self.ended = True
            self._changed.notify()

    def take(self) -> Frame | ImuSample | Signal:
        """The next measurement or signal; waits for it."""
        with self._changed:
            while (item := self._next()) is None:
                self._changed.wait()
            return item

    def _next(self) -> Frame | ImuSample | Signal | None:
        if self._reset:
            self._reset = False
            return Signal.RESET
        if self._frames:
            time = self._frames[0].stamp + self._shift
            is_next = not self._imu or self._imu[0].stamp >= time
            if is_next and (self._latest_imu >= time or self.ended):
                return self._frames.popleft()
        if self._imu and (self._imu[0].stamp <= self._latest_frame + _AHEAD or self.ended):
            return self._imu.popleft()
        return Signal.END if self.ended else None
