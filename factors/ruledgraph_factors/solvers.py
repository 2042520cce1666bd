# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of GTSAM's solvers that suit lines, and how a line is given a new chart in a graph."""

from collections.abc import Sequence
from typing import NamedTuple

import gtsam

from ruledgraph_factors.factor import RuledSurfaceFactor
from ruledgraph_factors.factor_spec import spec_of
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.spec import RuledSurfaceSpec


def isam2_params(relinearize_threshold: float = 0.01) -> gtsam.ISAM2Params:
    """Dogleg steps, relinearised at every update.

    A Gauss-Newton step from a line or a pose that is far off may end in another minimum, or in an
    indeterminate system; Dogleg shortens it.
    """
    params = gtsam.ISAM2Params()
    params.setOptimizationParams(gtsam.ISAM2DoglegParams())
    params.setRelinearizeThreshold(relinearize_threshold)
    params.relinearizeSkip = 1
    return params


def levenberg_marquardt_params() -> gtsam.LevenbergMarquardtParams:
    """Damping along the diagonal: beside stiff priors GTSAM's default may never take a step."""
    params = gtsam.LevenbergMarquardtParams()
    params.setDiagonalDamping(True)
    params.setlambdaUpperBound(1e10)
    return params


class MovedLine(NamedTuple):
    """What changes in a graph when a line gets another chart and key."""

    factors: gtsam.NonlinearFactorGraph
    """Its ruled-surface factors, on the new key."""
    indices: Sequence[int]
    """Of all factors on the old key, priors too: to be removed."""


def move_line(
    graph: gtsam.NonlinearFactorGraph, line_key: int, new_line_key: int, chart: LineChart
) -> MovedLine:
    """A line in a new chart, for graphs that keep all their factors (batch, ISAM2).

    Insert the new variable as zeros(4) and give it a new prior if the old one had one. Smoothers
    with a fixed lag have lost factors by then: use `same_line_factor` there.

    Args:
        graph: all factors; of ISAM2 its `getFactorsUnsafe()`.
        line_key: of the line until now.
        new_line_key: from now on.
        chart: for the new key, such as that of `LineChart.recentred` or `triangulate_line`.
    """
    moved, indices = gtsam.NonlinearFactorGraph(), []
    for index in range(graph.size()):
        factor = graph.at(index) if graph.exists(index) else None
        if factor is None or line_key not in list(factor.keys()):
            continue
        indices.append(index)
        spec = spec_of(factor)
        if isinstance(spec, RuledSurfaceSpec):
            moved.add(RuledSurfaceFactor(spec.with_line(new_line_key, chart)))
    return MovedLine(moved, indices)
