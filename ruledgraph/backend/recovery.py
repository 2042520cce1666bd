# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A window's factors and variables, for a new smoother when the old one has failed."""

from collections.abc import Iterable, Sequence

from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_factors import new_line_factors
from ruledgraph.backend.states import Interval, StateNode, joint_prior
from ruledgraph.core.config import Config


def rebuilt(
    nodes: Sequence[StateNode],
    intervals: Sequence[Interval],
    lines: Iterable[Landmark],
    config: Config,
) -> GraphUpdate:
    """A window's states and those of its lines that were seen from them, with priors on the first
    state.

    Args:
        nodes: one more than intervals.
        intervals: between them.
        lines: that are to be kept.
        config: all settings.
    """
    update = GraphUpdate()
    factors, values, times = update.factors, update.values, update.times
    random_walk = config.time_offset.random_walk
    factors.add(joint_prior(nodes[0]))
    for node in nodes:
        update.insert(node)
    time_offsets = [
        interval.time_offset for interval in intervals if interval.time_offset is not None
    ]
    for i, time_offset in enumerate(time_offsets):
        random_walk_factor = (
            time_offset.random_walk_factor(time_offsets[i - 1], random_walk) if i else None
        )
        factors.add(random_walk_factor or time_offset.prior())
        values.insert(time_offset.key, time_offset.residual_offset)
        times[time_offset.key] = time_offset.time
    kept = {id(line) for line in lines}
    for interval in intervals:
        for factor in interval.imu_factors:
            # A rest's first state may have left.
            if all(values.exists(key) for key in factor.keys()):  # noqa: SIM118
                factors.add(factor)
        for seen in interval.observations:
            line = seen.line
            # Factors on the key a line had before it was re-anchored stay out.
            if id(line) not in kept or line.key != seen.factor.spec.keys[-1]:
                continue
            factors.add(seen.factor)
            if line.key not in times:
                for factor in new_line_factors(interval.node, seen, config.lines):
                    factors.add(factor)
                values.insert(line.key, line.delta)
                times[line.key] = line.last_time
    return update
