# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is known of the time offset between camera and IMU."""

from typing import NamedTuple


class TimeOffset(NamedTuple):
    """An offset and its standard deviation, s; a positive one says that frames are taken after
    their stamps on the IMU's clock.
    """

    value: float
    sigma: float

    def moved(self, by: float) -> "TimeOffset":
        """The same counted from elsewhere."""
        return TimeOffset(self.value + by, self.sigma)


NO_OFFSET = TimeOffset(0.0, 0.0)
