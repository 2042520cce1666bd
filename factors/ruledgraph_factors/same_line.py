# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One line under two keys: how a long-lived line gets a new chart without losing what is known."""

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.line import LineChart
from ruledgraph_factors.validation import diagonal_noise, finite_array, graph_key, instance


def same_line_factor(
    noise_model: noiseModel.Diagonal,
    line_key: int,
    new_line_key: int,
    chart: LineChart,
    delta: ArrayLike,
    world_T_anchor: gtsam.Pose3,
) -> tuple[gtsam.LinearContainerFactor, LineChart]:
    """Ties a line's variable to another one of the same line in a new chart.

    Residual: r = J (delta_old - delta) - delta_new, (4,), with J of `LineChart.reanchor`. It is
    linear on purpose: smoothers with a fixed lag stop to linearise a variable anew once a neighbour
    has left the window, and J belongs where the line is now, not where it was then. That is when
    to use this factor, too: as soon as a line's estimate has moved away from the point it is
    linearised at. Insert the new variable as zeros(4) and use its key from then on; the old one may
    leave the window with all it knows.

    Args:
        noise_model: of dimension 4, as loose as the estimate has moved since the old variable was
            fixed (rad). What its marginal leaves open, place and heading of the whole, looks that
            much different here; a closer tie makes it known where it is not, and tears at it.
        line_key: Vector4, in `chart`.
        new_line_key: Vector4, in the new chart.
        chart: of the old variable.
        delta: its estimate, (4,).
        world_T_anchor: where to anchor the new chart.

    Returns:
        The factor and the new chart, in which the line is at zeros(4).

    Raises:
        FactorError: naming the argument that is wrong; or the line runs through the new anchor.
    """
    diagonal_noise(noise_model, 4)
    instance("chart", chart, LineChart)
    keys = [graph_key("line_key", line_key), graph_key("new_line_key", new_line_key)]
    here = finite_array("delta", delta, (4,))
    new_chart, by_delta = chart.reanchor(here, world_T_anchor)
    linear = gtsam.JacobianFactor(keys[0], by_delta, keys[1], -np.eye(4), np.zeros(4), noise_model)
    values = gtsam.Values()
    values.insert(keys[0], here)
    values.insert(keys[1], np.zeros(4))
    return gtsam.LinearContainerFactor(linear, values), new_chart
