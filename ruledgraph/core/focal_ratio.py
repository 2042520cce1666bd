# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's focal length over the calibration's, with its standard deviation."""

from typing import NamedTuple


class FocalRatio(NamedTuple):
    """A ratio, that of both focal lengths, and its standard deviation."""

    value: float
    sigma: float
