# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Signals that end a run between two measurements, so that nothing is left half done."""

import signal
import threading
from types import FrameType
from typing import Any

from ruledgraph.core.context import Closing

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class CaughtSignals(Closing):
    """While it is entered, the first SIGINT, SIGTERM or SIGHUP is noted; a second one acts as ever.

    Python lets the main thread alone handle signals; in another one nothing is caught.
    """

    def __init__(self) -> None:
        self.number = 0
        """Of the signal that came, 0 before."""
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> "CaughtSignals":
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in _SIGNALS}
        return self

    def close(self) -> None:
        """Handle signals as before."""
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.number = number
        self.close()
