# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The states of a window, one after another, and the intervals between them."""

from collections import deque

import gtsam
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.rest_factors import resting
from ruledgraph.backend.self_calibration import AS_CALIBRATED, CameraVariables
from ruledgraph.backend.states import Interval, StateNode


class StateSequence:
    """States in time order, one more than intervals."""

    def __init__(self, first: StateNode) -> None:
        self.nodes = deque([first])
        self.intervals: deque[Interval] = deque()

    @property
    def newest(self) -> StateNode:
        """The latest state."""
        return self.nodes[-1]

    @property
    def latest_interval(self) -> Interval | None:
        """The one that ends at the newest state; None with a single state."""
        return self.intervals[-1] if self.intervals else None

    @property
    def latest_camera(self) -> CameraVariables:
        """What is estimated of the camera at the newest state."""
        latest = self.latest_interval
        return latest.camera if latest else AS_CALIBRATED

    @property
    def rests_since(self) -> float:
        """Time of the first state of the rest that goes on, or of the newest state, s."""
        rest = resting(self.intervals)
        return rest[-1].node.time if rest else self.newest.time

    def append(self, interval: Interval, node: StateNode) -> None:
        """Add an interval and the state that ends it."""
        self.intervals.append(interval)
        self.nodes.append(node)

    def pop_before(self, time: float) -> Interval | None:
        """Drop the oldest state, if it is before a time (s), with the interval after it."""
        if not self.intervals or self.intervals[0].node.time >= time:
            return None
        self.nodes.popleft()
        return self.intervals.popleft()

    def read(self, estimate: gtsam.Values) -> None:
        """Take over what the smoother found."""
        for node in self.nodes:
            pose, velocity = estimate.atPose3(X(node.index)), estimate.atVector(V(node.index))
            node.state = gtsam.NavState(pose, velocity)
            node.bias = estimate.atConstantBias(B(node.index))
        for interval in self.intervals:
            for variable in interval.camera.estimated:
                variable.read(estimate)
