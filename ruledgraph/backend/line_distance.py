# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far away lines are, and how far a new one may be expected."""

import math
from collections.abc import Iterable
from statistics import fmean
from typing import NamedTuple

from ruledgraph.core.arrays import FloatArray
from ruledgraph_factors import LineChart

# Standard deviations that an inverse distance is from none, for the distance to be known.
_KNOWN = 3.0


class InverseDistance(NamedTuple):
    """One over a line's distance from the anchor of its chart, 1/m."""

    value: float
    sigma: float
    """Its standard deviation."""

    @classmethod
    def of(cls, chart: LineChart, delta: FloatArray, covariance: FloatArray) -> "InverseDistance":
        """Of the line at delta (4,) of a chart, known to a covariance (4, 4)."""
        value, slope = chart.inverse_distance(delta)
        return cls(value, math.sqrt(max(float(slope @ covariance @ slope), 0.0)))

    @property
    def is_known(self) -> bool:
        """Whether the line is in front, and not as good as at infinity."""
        return self.value > _KNOWN * self.sigma


def usual_distance(lines: Iterable[InverseDistance], prior: float) -> float:
    """Geometric mean of the known distances, where `prior` (m) counts as one line, m.

    With one distance for the lines of all scenes, the scale would be drawn to it.
    """
    logs = [-math.log(line.value) for line in lines if line.is_known]
    return math.exp(fmean([math.log(prior), *logs]))
