# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a start in motion holds."""

import numpy as np

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Start

# A start in motion is on trial for so long, s. When less than this share of its lines has stayed,
# or beyond these (m/s, rad/s, m/s^2), it was none.
_TRIAL, _LEAST_STAY = 0.7, 0.5
_FASTEST, _WORST_GYROSCOPE, _WORST_ACCELEROMETER = 20.0, 0.25, 1.5


class Trial:
    """A start in motion, made at a time, until most of its lines have been seen to stay."""

    def __init__(self, start: Start, time: float) -> None:
        self._numbers = set(start.lines)
        self._entered: set[int] = set()
        self._until = time + _TRIAL
        self.trouble = ""
        """Why it was none."""

    def passed(self, window: Window) -> bool:
        """Whether it is over and went well; look at `trouble` first."""
        knot = window.newest
        self._entered |= self._numbers & window.lines.keys()
        gone = len(self._entered - window.lines.keys())
        if gone > (1.0 - _LEAST_STAY) * len(self._numbers):
            self.trouble = f"{gone} of its {len(self._numbers)} lines did not fit for long"
        elif not (
            np.linalg.norm(knot.state.velocity()) < _FASTEST
            and np.linalg.norm(knot.bias.gyroscope()) < _WORST_GYROSCOPE
            and np.linalg.norm(knot.bias.accelerometer()) < _WORST_ACCELEROMETER
        ):
            self.trouble = "its velocity or biases are implausible"
        return not self.trouble and knot.time >= self._until
