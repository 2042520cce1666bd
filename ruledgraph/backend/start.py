# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a window begins with."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.line_distance import InverseDistance
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph_factors import LineChart


class InitialLine(NamedTuple):
    """What is known of a line when it enters: it is where its chart is, at delta = 0."""

    chart: LineChart
    covariance: FloatArray
    """Of delta, (4, 4), the states being known."""

    def inverse_distance(self) -> InverseDistance:
        """One over the distance from the anchor, 1/m."""
        return InverseDistance.of(self.chart, np.zeros(4), self.covariance)

    @classmethod
    def at(cls, chart: LineChart, delta: FloatArray, covariance: FloatArray) -> "InitialLine":
        """The line at delta (4,) of a chart, with its covariance there, in a chart around it.

        A chart is singular a full turn away, where a line without good points may have gone.
        """
        around, by_delta = chart.recentred(delta)
        return cls(around, by_delta @ covariance @ by_delta.T)


@dataclass(frozen=True, eq=False)
class Start:
    """Where a window begins."""

    stamp: int
    """Of its frame, ns."""
    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    covariance: FloatArray
    """Of pose, velocity and bias, (15, 15)."""
    lines: dict[int, InitialLine]
    """Of tracks by id: what is known of them already."""
    time_offset: TimeOffset | None = None
    """Beyond the frames' times; None: not to be estimated."""
    edge_variance: float = 1.0
    """Of edge points, over that of `edges.sigma_px`."""

    def moved(self, by: gtsam.Pose3) -> "Start":
        """The same start in another world: turned about the vertical and shifted, `by` a pose."""
        pose = by.compose(self.state.pose())
        velocity = by.rotation().rotate(self.state.velocity())
        lines = {}
        for number, line in self.lines.items():
            anchor = by.compose(line.chart.world_T_anchor)
            chart = LineChart(anchor, line.chart.basis, line.chart.angle)
            lines[number] = line._replace(chart=chart)
        return replace(self, state=gtsam.NavState(pose, velocity), lines=lines)
