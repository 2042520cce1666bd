# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's clock and its pose in the body, where a window estimates them."""

from typing import NamedTuple

from ruledgraph.backend.extrinsics import ExtrinsicsState
from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.backend.time_offset import TimeOffsetState
from ruledgraph.core.config import Config
from ruledgraph.core.extrinsics import Extrinsics
from ruledgraph.core.time_offset import TimeOffset


class SelfCalibration(NamedTuple):
    """What is known of the camera as of the newest interval; None of what is not estimated."""

    time_offset: TimeOffset | None
    """Beyond the calibration's."""
    extrinsics: Extrinsics | None

    def time_offset_of(self, node: StateNode, offset_correction: float) -> TimeOffsetState | None:
        """A variable for the frames after a state, s being added to their times already."""
        if self.time_offset is None:
            return None
        value, sigma = self.time_offset
        residual = value - offset_correction
        return TimeOffsetState(node.index, node.time, offset_correction, residual, sigma)

    def extrinsics_of(self, node: StateNode) -> ExtrinsicsState | None:
        """A variable for the frames after a state."""
        if self.extrinsics is None:
            return None
        return ExtrinsicsState(node.index, node.time, *self.extrinsics)

    def after(self, interval: Interval) -> "SelfCalibration":
        """As an interval's variables have it."""
        offset, extrinsics = interval.time_offset, interval.extrinsics
        return SelfCalibration(
            None if offset is None else offset.offset,
            None if extrinsics is None else extrinsics.extrinsics,
        )


def add_self_calibration(
    update: GraphUpdate, interval: Interval, before: Interval | None, config: Config
) -> None:
    """Add an interval's variables of the camera, tied to those of the interval before; the first
    one's have priors.
    """
    offset = interval.time_offset
    if offset is not None:
        earlier = None if before is None else before.time_offset
        walk = config.time_offset.random_walk
        tie = offset.prior() if earlier is None else offset.random_walk_factor(earlier, walk)
        update.factors.add(tie)
        update.values.insert(offset.key, offset.residual_offset)
        update.times[offset.key] = offset.time
    mounted = interval.extrinsics
    if mounted is not None:
        was_mounted = None if before is None else before.extrinsics
        walks = config.extrinsics.rotation_random_walk, config.extrinsics.translation_random_walk
        tie = mounted.random_walk_factor(was_mounted, *walks) if was_mounted else mounted.prior()
        update.factors.add(tie)
        update.values.insert(mounted.key, mounted.body_T_cam)
        update.times[mounted.key] = mounted.time
