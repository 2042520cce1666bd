# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A prior on a new line that says nothing of where in the world it is."""

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.validation import (
    FloatArray,
    diagonal_noise,
    graph_key,
    instance,
    pose,
)


def new_line_factor(
    noise_model: noiseModel.Diagonal,
    pose_key: int,
    line_key: int,
    chart: LineChart,
    world_T_body: gtsam.Pose3,
) -> gtsam.LinearContainerFactor:
    """As seen from a pose, a line is about where its chart's reference is.

    Residual: r = delta - F xi, (4,), with xi the pose's coordinates (rotation first) at
    `world_T_body` and F the derivative of delta when the line moves with the pose:

        F xi = (sin(phi)^2 u3 . t,  u1 . w,  u2 . w - tan(phi) u1 . t,  u3 . w)

    w and t being the pose's turn and its shift at the anchor's centre, in the anchor frame, and
    u1, u2, u3, phi the chart's. It is linear on purpose, as wide as such a prior is, and holds
    delta wherever it goes.

    A prior on delta alone would be one in the world: with every line that comes and goes they add
    up to knowledge of place and heading that nothing shows, and the poses are drawn along.

    Args:
        noise_model: of dimension 4, of delta (rad), such as `NEW_LINE_SIGMAS`.
        pose_key: Pose3, world_T_body of a knot that saw the line.
        line_key: Vector4, delta of `chart`.
        chart: of the line.
        world_T_body: estimate of the pose, from which the reference line was made.

    Raises:
        FactorError: naming the argument that is wrong; or the reference line runs through the
            anchor.
    """
    diagonal_noise(noise_model, 4)
    instance("chart", chart, LineChart)
    pose("world_T_body", world_T_body)
    keys = graph_key("pose_key", pose_key), graph_key("line_key", line_key)
    by_pose = -moved_with(chart, world_T_body)
    linear = gtsam.JacobianFactor(keys[0], by_pose, keys[1], np.eye(4), np.zeros(4), noise_model)
    values = gtsam.Values()
    values.insert(keys[0], world_T_body)
    values.insert(keys[1], np.zeros(4))
    return gtsam.LinearContainerFactor(linear, values)


def moved_with(chart: LineChart, world_T_body: gtsam.Pose3) -> FloatArray:
    """F, (4, 6): the derivative of the reference line's delta when it moves with a pose.

    Raises:
        FactorError: when the reference line runs through the anchor.
    """
    sine, cosine = np.sin(chart.angle), np.cos(chart.angle)
    if abs(cosine) < 1e-6:
        raise FactorError("chart: its reference line runs through its anchor")
    anchor_T_body = chart.world_T_anchor.between(world_T_body)
    turn = anchor_T_body.rotation().matrix()
    shift = np.hstack([hat(anchor_T_body.translation()) @ turn, turn])
    by_turn = np.hstack([chart.basis.T @ turn, np.zeros((3, 3))])
    by_shift = chart.basis.T @ shift
    return np.array(
        [
            sine**2 * by_shift[2],
            by_turn[0],
            by_turn[1] - sine / cosine * by_shift[0],
            by_turn[2],
        ]
    )
