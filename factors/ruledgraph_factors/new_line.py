# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What one image does not show of a line: how far away it is, and how it runs in its plane."""

import math

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.so3 import hat
from ruledgraph_factors.validation import FloatArray, graph_key, instance, pose, positive_number

# So close to the pose or to infinity (rad) the logarithm goes on straight.
_STRAIGHT = 0.05
# A moment, or a direction within the reference plane, is no shorter than this.
_LEAST = 1e-12


def new_line_factor(
    noise_model: noiseModel.Base,
    pose_key: int,
    line_key: int,
    chart: LineChart,
    world_T_body: gtsam.Pose3,
    distance: float,
) -> gtsam.CustomFactor:
    """A line as seen from a pose is about so far away and runs about like the chart's reference.

    Residual, (2,):

        r0 = log(tan(phi) distance)          tan(phi): inverse distance from the pose's origin
        r1 = atan2(b . d, a . d)             d: the line's direction as seen from the pose

    with phi = atan2(sin(phi_A), |m|), m the moment about the pose's origin at the scale of the
    chart, phi_A the chart's angle, whose sign phi takes; a the direction of the reference line and
    b the perpendicular to it in its plane, both as seen from `world_T_body`. Where the line comes
    close to infinity or to the pose r0 goes on along the tangent, so that it is defined for every
    line.

    A line along the motion shows no depth, and a small error of the velocity across it looks like
    depth: a normal prior on the chart then gives way and the line goes to infinity, where it holds
    the camera no longer. The logarithm does not give way. And a prior on the chart would be one in
    the world: it adds up, with every line that comes and goes, to knowledge of place and heading
    that nothing shows. This one says nothing of where pose and line are together.

    Args:
        noise_model: of dimension 2: the logarithm of the factor by which the distance may be
            wrong, log(4) for 1 / 4 to 4 times, and the angle, rad.
        pose_key: Pose3, world_T_body of a knot that saw the line.
        line_key: Vector4, delta of `chart`.
        chart: of the line.
        world_T_body: estimate of that pose, from which the reference line was made.
        distance: median, m.

    Raises:
        FactorError: naming the argument that is wrong.
    """
    instance("chart", chart, LineChart)
    pose("world_T_body", world_T_body)
    keys = [graph_key("pose_key", pose_key), graph_key("line_key", line_key)]
    log_distance = math.log(positive_number("distance", distance))
    body_R_anchor = world_T_body.rotation().between(chart.world_T_anchor.rotation()).matrix()
    plane = np.asfortranarray(body_R_anchor @ chart.basis[:, 1:])

    def error(
        this: gtsam.CustomFactor, values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        pose_key, line_key = this.keys()
        pose, delta = values.atPose3(pose_key), values.atVector(line_key)
        value, by_pose, by_line = seen_from(chart, delta, pose, plane, log_distance)
        if H is not None:
            H[0], H[1] = np.asfortranarray(by_pose), np.asfortranarray(by_line)
        return value

    factor = gtsam.CustomFactor(noise_model, keys, error)
    if factor.dim() != 2:
        raise FactorError(f"noise_model has dimension {factor.dim()}, but this factor has 2 rows")
    return factor


def seen_from(
    chart: LineChart,
    delta: FloatArray,
    world_T_body: gtsam.Pose3,
    plane: FloatArray,
    log_distance: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The residual, (2,), and its derivatives by the pose, (2, 6), and by delta, (2, 4); `plane`
    is a and b, (3, 2).
    """
    if active_kernel() == "numpy":
        return new_line_in_numpy(chart, delta, world_T_body, plane, log_distance)
    anchor, body = chart.world_T_anchor.matrix(), world_T_body.matrix()
    return native.new_line(anchor, chart.basis, chart.angle, delta, body, plane, log_distance)


def new_line_in_numpy(
    chart: LineChart,
    delta: FloatArray,
    world_T_body: gtsam.Pose3,
    plane: FloatArray,
    log_distance: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The reference of `_native.new_line`."""
    phi, phi_by_pose, phi_by_line = _inverse_distance_angle(chart, delta, world_T_body)
    # To the logarithm's range and back: r0(phi) and its slope beyond it are those at its end.
    inside = min(max(phi, _STRAIGHT), 0.5 * math.pi - _STRAIGHT)
    slope = 2.0 / math.sin(2.0 * inside)
    stretch = math.log(math.tan(inside)) + log_distance + slope * (phi - inside)
    body_R_world = world_T_body.rotation().matrix().T
    direction, by_delta = chart.direction(delta)
    seen = body_R_world @ direction
    x, y = seen @ plane
    by_seen = (x * plane[:, 1] - y * plane[:, 0]) / max(x * x + y * y, _LEAST)
    turn_by_pose = np.concatenate([by_seen @ hat(seen), np.zeros(3)])
    return (
        np.array([stretch, math.atan2(y, x)]),
        np.array([slope * phi_by_pose, turn_by_pose]),
        np.array([slope * phi_by_line, by_seen @ body_R_world @ by_delta]),
    )


def _inverse_distance_angle(
    chart: LineChart, delta: FloatArray, pose: gtsam.Pose3
) -> tuple[float, FloatArray, FloatArray]:
    """phi, and its derivatives by the pose, (6,), and by delta, (4,)."""
    place, rotation = pose.translation(), pose.rotation().matrix()
    plucker, by_delta = chart.plucker(delta)
    direction, across = plucker[3:], hat(place)
    moment = plucker[:3] - across @ direction
    moment_by_delta = by_delta[:3] - across @ by_delta[3:]
    size = max(float(np.linalg.norm(moment)), _LEAST)
    sine, cosine = math.sin(chart.angle + delta[0]), math.cos(chart.angle + delta[0])
    # d atan2(sine, size) = (size d sine - sine d size) / (size^2 + sine^2)
    by_size = -sine / (size**2 + sine**2) * (moment / size)
    by_line = by_size @ moment_by_delta
    by_line[0] += size * cosine / (size**2 + sine**2)
    by_pose = np.concatenate([np.zeros(3), by_size @ hat(direction) @ rotation])
    return math.atan2(sine, size), by_pose, by_line
