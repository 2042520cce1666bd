# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A window's factors and variables, for a new smoother when the old one has failed."""

from collections.abc import Iterable, Sequence

from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_distance import usual_distance
from ruledgraph.backend.line_factors import new_line_factors
from ruledgraph.backend.rest_factors import rests_throughout
from ruledgraph.backend.self_calibration import AS_CALIBRATED
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
    factors.add(joint_prior(nodes[0]))
    for node in nodes:
        update.insert(node)
    before = AS_CALIBRATED
    for interval in intervals:
        update.insert_camera(interval, before, config)
        before = interval.camera
    kept = {id(line): line.inverse_distance() for line in lines}
    distance = usual_distance(kept.values(), config.lines.prior_distance)
    rests = rests_throughout(intervals)
    for interval in intervals:
        factors.add(interval.imu_factor)
        for factor in interval.rest_factors:
            # A rest's first state may have left.
            if all(values.exists(key) for key in factor.keys()):  # noqa: SIM118
                factors.add(factor)
        for seen in interval.observations:
            line = seen.line
            if id(line) not in kept:
                continue
            seen.in_graph = not (rests and line.key in times)  # as in `LineGraphBuilder.observe`
            if not seen.in_graph:
                continue
            factors.add(seen.factor)
            if line.key not in times:
                for factor in new_line_factors(interval.node, line, config.lines, distance):
                    factors.add(factor)
                values.insert(line.key, line.delta)
                times[line.key] = line.last_time
                line.linearization_frozen = False
    return update
