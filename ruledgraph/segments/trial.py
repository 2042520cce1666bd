# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a start in motion is accepted."""

import numpy as np
from scipy.special import chdtri

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.start import Start
from ruledgraph.backend.states import StateNode
from ruledgraph.core.config import Config


class Trial:
    """A start in motion, made at a time, until its lines have been seen to stay and lines and
    estimate agree.
    """

    def __init__(self, start: Start, time: float, config: Config) -> None:
        self._config = config.integrity
        self._bias_sigmas = np.sqrt(np.diag(start.covariance)[9:])
        self._threshold = float(chdtri(len(self._bias_sigmas), 1.0 - config.start.confidence))
        self._line_ids = set(start.lines)
        self._entered: set[int] = set()
        self._until = time + self._config.trial_time
        self.failure = ""
        """Why the start is rejected."""
        self.is_passed = False
        """Whether it is over, and the start is accepted."""

    def update(self, window: Window, lines_fit: bool) -> None:
        """Take in a window's newest state, and whether nearly all lines fit it."""
        node = window.newest
        self._entered |= self._line_ids & window.lines.keys()
        gone = len(self._entered - window.lines.keys())
        if gone > (1.0 - self._config.trial_min_stay) * len(self._line_ids):
            self.failure = f"{gone} of its {len(self._line_ids)} lines were rejected"
        elif self._is_unlikely(node):
            self.failure = "its IMU biases are implausibly large"
        elif not lines_fit and node.time >= self._until + self._config.lost_time:
            self.failure = "too many lines do not fit it"
        self.is_passed = not self.failure and lines_fit and node.time >= self._until

    def _is_unlikely(self, node: StateNode) -> bool:
        """Whether biases contradict what is known of them before a start, by a chi-square test:
        where lines say little of them, wrong ones pull them and the tilt away together.
        """
        whitened = node.bias.vector() / self._bias_sigmas
        return float(whitened @ whitened) > self._threshold
