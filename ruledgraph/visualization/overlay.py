# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What pictures over the camera's images have in common."""

from collections import deque

import matplotlib as mpl

from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry

_COLORS = mpl.colormaps["tab20"]
# Without a single line in sight nothing says which frames were processed; more than so many do not
# wait.
_MOST_WAITING = 8


def line_color(number: int) -> tuple[int, int, int]:
    """Red, green, blue of a line, 0 to 255, the same wherever it is drawn."""
    red, green, blue, _ = _COLORS(number % _COLORS.N)
    return round(255 * red), round(255 * green), round(255 * blue)


class FrameQueue:
    """Holds frames until the odometry has processed them, for which it waits for the IMU.

    When a frame has just been added, the tracks are those of the frame before, without the ones
    that will only be started there.
    """

    def __init__(self) -> None:
        self._waiting: deque[Frame] = deque()

    def take(self, odometry: Odometry, added: Frame) -> list[Frame]:
        """The frames processed since the last call; `added` is the one just added."""
        self._waiting.append(added)
        newest = max(
            (t.sightings[-1].stamp for t in odometry.tracker.tracks if t.sightings), default=-1
        )
        taken = []
        while self._waiting and (
            self._waiting[0].stamp <= newest or len(self._waiting) > _MOST_WAITING
        ):
            taken.append(self._waiting.popleft())
        return taken
