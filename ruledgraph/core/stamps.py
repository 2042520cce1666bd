# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Stamps in another unit than nanoseconds, noticed by how they follow each other."""

from numbers import Integral

from ruledgraph.core.errors import RuledgraphError

CLOSEST_SAMPLES, CLOSEST_FRAMES = 20_000, 200_000
"""ns; no IMU and no camera deliver faster."""

# So many stamps in a row that follow too closely, or too far apart, are no disorder of a stream:
# batches of samples with one stamp are shorter, and so are outages.
_MANY_CLOSE, _MANY_SPARSE = 50, 10


class StampUnit:
    """Of one sensor's stamps. They may come twice, late and with gaps.

    Args:
        what: the measurements, in the plural.
        closest: ns; no sensor delivers faster.
        farthest: ns; measurements further apart are no use, None where that says nothing.
    """

    def __init__(self, what: str, closest: int, farthest: int | None = None) -> None:
        self._what = what
        self._closest = closest
        self._farthest = farthest
        self._last: int | None = None
        self._close = self._sparse = 0

    def check(self, stamp: int) -> None:
        """Take note of the next stamp.

        Raises:
            RuledgraphError: for one that is no integer of 64 bit, and when many in a row are too
                close together or too far apart for nanoseconds.
        """
        if not isinstance(stamp, Integral):
            raise RuledgraphError(
                f"a stamp of {stamp!r} is no whole number of nanoseconds; ImuSample.of and "
                "Frame.of take seconds as t="
            )
        if not 0 <= stamp < 2**63:
            raise RuledgraphError(f"a stamp of {stamp} nanoseconds is not within 0 to 2^63")
        last, self._last = self._last, stamp
        if last is None:
            return
        apart = stamp - last
        self._close = self._close + 1 if 0 <= apart < self._closest else 0
        far = self._farthest is not None and apart > self._farthest
        self._sparse = self._sparse + 1 if far else 0
        if self._close >= _MANY_CLOSE or self._sparse >= _MANY_SPARSE:
            shown = f"{apart} ns" if self._close else f"{apart * 1e-9:g} s"
            raise RuledgraphError(
                f"{self._what} come {shown} apart: check the unit of their stamps, which are "
                "nanoseconds; ImuSample.of and Frame.of take seconds as t="
            )
