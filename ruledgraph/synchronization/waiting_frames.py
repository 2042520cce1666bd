# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The frames that wait for the IMU, in bounded memory whatever it does."""

from collections import deque

from ruledgraph.core.measurements import Frame


class WaitingFrames:
    """Frames in order of their stamps, not further apart than a time.

    Args:
        longest: ns, between the first and the last.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._frames: deque[Frame] = deque()

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def first(self) -> Frame | None:
        """The one that is next."""
        return self._frames[0] if self._frames else None

    @property
    def last(self) -> Frame | None:
        """The newest."""
        return self._frames[-1] if self._frames else None

    def add(self, frame: Frame) -> int | None:
        """Append a frame that is later than all. A last one whose stamp had jumped far ahead goes.

        Returns:
            How many had to be dropped for it; None if it is not later and was left out.
        """
        dropped = 0
        while self._frames and self._frames[-1].stamp >= frame.stamp:
            if self._frames[-1].stamp - frame.stamp <= self._longest:
                return None
            self._frames.pop()
            dropped += 1
        self._frames.append(frame)
        while frame.stamp - self._frames[0].stamp > self._longest:
            self._frames.popleft()
            dropped += 1
        return dropped

    def take(self) -> Frame:
        """Remove the first."""
        return self._frames.popleft()
