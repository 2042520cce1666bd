# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A prior on how far away a line is."""

import math

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.validation import FloatArray, graph_key, instance, positive_number

# So close to the anchor's centre or to infinity (rad of phi) the logarithm goes on straight.
_STRAIGHT = 0.01


def line_distance_prior(
    noise_model: noiseModel.Base, line_key: int, chart: LineChart, distance: float
) -> gtsam.CustomFactor:
    """A line is about so far from its chart's anchor, give or take a factor.

    Residual: r = log(tan(phi) distance), (1,), with tan(phi) the line's inverse distance; where the
    line comes close to infinity or to the anchor's centre it goes on along the tangent, so that it
    is defined for every line.

    A line along the motion shows no depth, and a small error of the velocity across it looks like
    depth: a normal prior on phi then gives way and the line goes to infinity, where it holds the
    camera no longer. This one does not give way.

    Args:
        noise_model: of dimension 1: the logarithm of the factor, log(4) for 1 / 4 to 4 times.
        line_key: Vector4, delta of `chart`.
        chart: of the line.
        distance: median, m.

    Raises:
        FactorError: naming the argument that is wrong.
    """
    instance("chart", chart, LineChart)
    key = graph_key("line_key", line_key)
    log_distance = math.log(positive_number("distance", distance))
    angle = chart.angle

    def error(
        this: gtsam.CustomFactor, values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        phi = angle + float(values.atVector(this.keys()[0])[0])
        # To the logarithm's range and back: r(phi) and its slope beyond it are those at its end.
        inside = min(max(phi, _STRAIGHT), 0.5 * math.pi - _STRAIGHT)
        slope = 2.0 / math.sin(2.0 * inside)
        if H is not None:
            H[0] = np.array([[slope, 0.0, 0.0, 0.0]], order="F")
        return np.array([math.log(math.tan(inside)) + log_distance + slope * (phi - inside)])

    factor = gtsam.CustomFactor(noise_model, [key], error)
    if factor.dim() != 1:
        raise FactorError(f"noise_model has dimension {factor.dim()}, but this factor has 1 row")
    return factor
