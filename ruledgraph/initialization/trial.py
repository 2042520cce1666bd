# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a start in motion holds."""

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.start import Start
from ruledgraph.core.config import IntegrityConfig


class Trial:
    """A start in motion, made at a time, until most of its lines have been seen to stay."""

    def __init__(self, start: Start, time: float, config: IntegrityConfig) -> None:
        self._config = config
        self._numbers = set(start.lines)
        self._entered: set[int] = set()
        self._until = time + config.trial_time
        self.trouble = ""
        """Why it was none."""

    def passed(self, window: Window) -> bool:
        """Whether it is over and went well; look at `trouble` first."""
        node = window.newest
        self._entered |= self._numbers & window.lines.keys()
        gone = len(self._entered - window.lines.keys())
        if gone > (1.0 - self._config.trial_min_stay) * len(self._numbers):
            self.trouble = f"{gone} of its {len(self._numbers)} lines did not fit for long"
        elif not node.keeps(self._config, self._config.trial_share):
            self.trouble = "its velocity or biases are implausible"
        return not self.trouble and node.time >= self._until
