# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One line under two keys: how a long-lived line gets a new chart without losing what is known."""

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.so3 import inverse_right_jacobian
from ruledgraph_factors.validation import FloatArray, graph_key, instance


def same_line_factor(
    noise_model: noiseModel.Base,
    line_key: int,
    new_line_key: int,
    chart: LineChart,
    new_chart: LineChart,
) -> gtsam.CustomFactor:
    """Ties a line's variable to another of the same line in a new chart.

    Residual: r = delta of the first line in the new chart - delta of the second, (4,). A fixed
    chart is good near its reference only. When a line has moved away from it, make a new chart with
    `LineChart.reanchor`, a new variable at zeros(4), this factor with a small deviation between the
    two, and use the new key from then on; the old one may leave the window with all it knows.

    Args:
        noise_model: of dimension 4.
        line_key: Vector4, delta of `chart`.
        new_line_key: Vector4, delta of `new_chart`.
        chart: of the old variable.
        new_chart: of the new one, near the line.

    Raises:
        FactorError: naming the argument that is wrong.
    """
    instance("noise_model", noise_model, noiseModel.Base)
    instance("chart", chart, LineChart)
    instance("new_chart", new_chart, LineChart)
    keys = [graph_key("line_key", line_key), graph_key("new_line_key", new_line_key)]

    def error(
        this: gtsam.CustomFactor, values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        keys = this.keys()
        old, new = values.atVector(keys[0]), values.atVector(keys[1])
        here, by_old = chart.reanchor(old, new_chart.world_T_anchor)
        turn = gtsam.Rot3.Logmap(gtsam.Rot3(new_chart.basis.T @ here.basis))
        if H is not None:
            by_here = np.eye(4)
            by_here[:3, :3] = inverse_right_jacobian(turn)
            H[0] = np.asfortranarray(by_here @ by_old)
            H[1] = np.asfortranarray(-np.eye(4))
        return np.append(turn, here.angle - new_chart.angle) - new

    factor = gtsam.CustomFactor(noise_model, keys, error)
    if factor.dim() != 4:
        raise FactorError(f"noise_model has dimension {factor.dim()}, but this factor has 4 rows")
    return factor
