# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset between camera and IMU, with its standard deviation."""

from typing import NamedTuple


class TimeOffset(NamedTuple):
    """An offset and its standard deviation, s; a positive one says that frames are taken after
    their stamps on the IMU's clock.
    """

    value: float
    sigma: float

    def plus(self, other: float) -> "TimeOffset":
        """The sum with a known offset, s."""
        return TimeOffset(self.value + other, self.sigma)


NO_OFFSET = TimeOffset(0.0, 0.0)
