# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The messages of a run, in bounded memory."""

import logging
import re

# Messages that are kept of a run; the rest are counted.
_MAX_MESSAGES = 200
_FIGURES = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")

_log = logging.getLogger("ruledgraph")


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
