# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Timings and messages of a run, in bounded memory."""

import logging
import math
import re
import time as clock
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

# Bins of the histogram differ by this ratio, from this many s on.
_RATIO, _SHORTEST = 1.02, 1e-7
# Messages that are kept of a run; the rest are counted.
_MAX_MESSAGES = 200
_FIGURES = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")

_log = logging.getLogger("ruledgraph")


class Timing:
    """Durations of one stage, s: their number, sum and extremes, and a histogram."""

    def __init__(self) -> None:
        self.count = 0
        self.total = 0.0
        self.largest = 0.0
        self.last = 0.0
        self._bins: dict[int, int] = {}

    def add(self, seconds: float) -> None:
        """Take in a duration."""
        self.count += 1
        self.total += seconds
        self.largest = max(self.largest, seconds)
        self.last = seconds
        index = math.floor(math.log(max(seconds, _SHORTEST) / _SHORTEST) / math.log(_RATIO))
        self._bins[index] = self._bins.get(index, 0) + 1

    @property
    def mean(self) -> float:
        """Of all, s."""
        return self.total / max(self.count, 1)

    def quantile(self, share: float) -> float:
        """The duration that no more than `share` of all stay below, to 1 %, s."""
        below = 0
        for index, count in sorted(self._bins.items()):
            below += count
            if below >= share * self.count:
                return min(_SHORTEST * math.pow(_RATIO, index + 0.5), self.largest)
        return self.largest


class Timings(defaultdict[str, Timing]):
    """How long each stage took."""

    def __init__(self) -> None:
        super().__init__(Timing)

    @contextmanager
    def measured(self, stage: str) -> Iterator[None]:
        """Add what is done inside to a stage."""
        start = clock.perf_counter()
        yield
        self[stage].add(clock.perf_counter() - start)


class Messages(list[str]):
    """The messages of a run: of those that differ in figures alone the first, with their number.

    Beyond the first kinds they are counted. All go to the logger `ruledgraph`, too, as warnings.
    """

    def __init__(self) -> None:
        super().__init__()
        self.left_off = 0
        self._once: set[str] = set()
        self._in_a_row: dict[str, int] = {}
        self._counts: dict[str, tuple[int, int, str]] = {}

    def append(self, message: str) -> None:
        """Keep a message, or count it."""
        self.counted(_FIGURES.sub("#", message), message)

    def once(self, kind: str, message: str) -> None:
        """Append the first message of a kind."""
        if kind not in self._once:
            self._once.add(kind)
            self.append(message)

    def lasting(self, kind: str, message: str | None, times: int) -> bool:
        """Append the first message of a kind that has come so many times in a row, None between
        them counting as its absence. Returns whether it has.
        """
        self._in_a_row[kind] = self._in_a_row.get(kind, 0) + 1 if message else 0
        lasts = self._in_a_row[kind] >= times
        if message and lasts:
            self.once(kind, message)
        return lasts

    def counted(self, kind: str, message: str) -> None:
        """Append the first message of a kind, and how often it came when it comes again."""
        if kind not in self._counts:
            if len(self) >= _MAX_MESSAGES:
                self.left_off += 1
                return
            self._counts[kind] = len(self), 0, message
            super().append(message)
            _log.warning("%s", message)
        place, count, first = self._counts[kind]
        self._counts[kind] = place, count + 1, first
        if count:
            self[place] = f"{first} ({count + 1} times)"
