# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How long the stages of a run take, in bounded memory."""

import math
import time as clock
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

# Bins of the histogram differ by this ratio, from this many s on.
_RATIO, _SHORTEST = 1.02, 1e-7


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
