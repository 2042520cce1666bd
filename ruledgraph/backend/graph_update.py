# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the next update adds to the smoother."""

from collections.abc import Collection
from dataclasses import dataclass, field

import gtsam
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.fixed_lag_smoother import Removal
from ruledgraph.backend.self_calibration import CameraVariables
from ruledgraph.backend.states import Interval, StateNode, insert_state
from ruledgraph.core.config import Config


@dataclass(eq=False)
class GraphUpdate:
    """New factors and variables, times of new and of refreshed variables (s), and the factors of
    earlier updates that are to be removed.
    """

    factors: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    values: gtsam.Values = field(default_factory=gtsam.Values)
    times: dict[int, float] = field(default_factory=dict)
    removal: Removal = field(default_factory=lambda: Removal(set(), []))

    def insert(self, node: StateNode) -> None:
        """Add the variables of a state."""
        insert_state(self.values, node)
        self.times |= {key(node.index): node.time for key in (X, V, B)}

    def remove(self, factors: Collection[gtsam.CustomFactor]) -> None:
        """Remove factors, be they new ones or some that the smoother has."""
        ids = {id(factor) for factor in factors}
        new = [self.factors.at(i) for i in range(self.factors.size())]
        self.factors = gtsam.NonlinearFactorGraph()
        for factor in new:
            if id(factor) not in ids:
                self.factors.add(factor)
        ids -= {id(factor) for factor in new}
        self.removal.factors.extend(factor for factor in factors if id(factor) in ids)

    def insert_camera(self, interval: Interval, before: CameraVariables, config: Config) -> None:
        """Add an interval's new variables of the camera, with random walks from those of the
        interval before; the first ones get priors.
        """
        for variable in interval.camera.new_since(before):
            variable.insert(self.values)
        for variable in interval.camera.estimated:
            self.times[variable.key] = interval.node.time
        for factor in interval.camera.factors(before, config):
            self.factors.add(factor)
