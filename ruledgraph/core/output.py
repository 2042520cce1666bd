# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How an odometry hands out what it has found."""

from collections.abc import Iterable

from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.messages import Messages
from ruledgraph.core.timing import Timings


class Output:
    """Estimates and lines until they are taken, messages and timings."""

    def __init__(self) -> None:
        self.warnings = Messages()
        self.recoveries: list[str] = []
        self.timings = Timings()
        """How long each stage took."""
        self._live: list[Estimate] = []
        self._smoothed: list[Estimate] = []
        self._lines: list[LineEstimate] = []

    def put(
        self,
        live: Iterable[Estimate] = (),
        smoothed: Iterable[Estimate] = (),
        lines: Iterable[LineEstimate] = (),
    ) -> None:
        """Add what is to be taken."""
        self._live += live
        self._smoothed += smoothed
        self._lines += lines

    def take_live(self) -> list[Estimate]:
        """Estimates as known at each frame's time, since the last call."""
        taken, self._live = self._live, []
        return taken

    def take_smoothed(self) -> list[Estimate]:
        """Estimates of the frames that left the window, since the last call."""
        taken, self._smoothed = self._smoothed, []
        return taken

    def take_lines(self) -> list[LineEstimate]:
        """Lines that left the window, since the last call."""
        taken, self._lines = self._lines, []
        return taken
