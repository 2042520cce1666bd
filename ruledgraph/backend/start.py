# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a window begins with."""

from dataclasses import dataclass, replace

import gtsam

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.time_offset import TimeOffset
from ruledgraph_factors import LineChart


@dataclass(frozen=True, eq=False)
class Start:
    """Where a window begins."""

    stamp: int
    """Of its frame, ns."""
    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    pose_covariance: FloatArray
    velocity_sigma: float
    bias_sigmas: FloatArray
    lines: dict[int, tuple[LineChart, FloatArray]]
    """Of tracks by number: what is known of them already."""
    time_offset: TimeOffset | None = None
    """Beyond the frames' times; None: not to be estimated."""

    def moved(self, by: gtsam.Pose3) -> "Start":
        """The same start in another world: turned about the vertical and shifted, `by` a pose."""
        pose = by.compose(self.state.pose())
        velocity = by.rotation().rotate(self.state.velocity())
        lines = {
            number: (LineChart(by.compose(chart.world_T_anchor), chart.basis, chart.angle), delta)
            for number, (chart, delta) in self.lines.items()
        }
        return replace(self, state=gtsam.NavState(pose, velocity), lines=lines)
