# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far the estimate moves while the body rests."""

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.messages import Messages


class RestSlide:
    """Takes the motion of the estimate while the body rests for an error of the position.

    Args:
        warnings: messages for the user.
        warn_distance: from which distance, m.
    """

    def __init__(self, warnings: Messages, warn_distance: float) -> None:
        self._warnings = warnings
        self._warn_distance = warn_distance
        self._rest_position: FloatArray | None = None
        self._slide = np.zeros(3)

    def update(
        self, position: FloatArray, time: float, still: bool, stayed_at: FloatArray | None = None
    ) -> FloatArray:
        """Take in a state's position at a time (s), whether the body has rested until then, and
        where it did so before that was known, if the estimate went on.

        Returns:
            Covariance of the position that remains when a rest is over, (3, 3), m^2.
        """
        if not still:
            stays = self.covariance()
            self._rest_position, self._slide = None, np.zeros(3)
            return stays
        if self._rest_position is None:
            self._rest_position = position if stayed_at is None else stayed_at
        before, self._slide = self._slide, position - self._rest_position
        if np.linalg.norm(before) < self._warn_distance <= np.linalg.norm(self._slide):
            self._warnings.append(
                f"the estimate has moved by {np.linalg.norm(self._slide):.2f} m at "
                f"{time:.2f} s, and the camera has not: lines may be wrong"
            )
        return np.zeros((3, 3))

    def covariance(self) -> FloatArray:
        """Of the position in the world for the motion so far, (3, 3), m^2."""
        return np.outer(self._slide, self._slide)
