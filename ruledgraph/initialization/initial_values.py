# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Where the batch problem of a first window begins: state and lines before the first iteration."""

from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.first_window import FirstWindow
from ruledgraph_factors import (
    FrameMotion,
    LineChart,
    level_attitude,
    line_from_ruling,
)
from ruledgraph_factors.closed_form import ClosedForm

# The closed form's lines that come out nearer or further than this begin in between, m.
_NEAR, _FAR, _BETWEEN = 0.1, 50.0, 5.0


class InitialValues(NamedTuple):
    """State at the window's first frame, whose position is the origin, and lines."""

    bias: gtsam.imuBias.ConstantBias
    upright: gtsam.Rot3
    """world_R_body by the accelerometer alone."""
    attitude: gtsam.Rot3
    """world_R_body."""
    velocity: FloatArray
    """In the world, (3,), m/s."""
    charts: list[LineChart]
    """Of the lines, at zero delta."""


def at_distance(window: FirstWindow, gyroscope_bias: FloatArray, distance: float) -> InitialValues:
    """No velocity, and all lines so far away, m."""
    bias, motion, upright = _by_imu(window, gyroscope_bias)
    velocity = np.zeros(3)
    poses = _poses(window, motion, upright, velocity, bias)
    charts = []
    for line in window.seen:
        anchor = gtsam.Pose3(poses[line.frames[0]].rotation(), np.zeros(3))
        world_T_cam = anchor.compose(window.calibration.body_T_cam)
        charts.append(line_from_ruling(world_T_cam, line.sightings[0].points, 1.0 / distance))
    return InitialValues(bias, upright, upright, velocity, charts)


def from_closed_form(
    window: FirstWindow, gyroscope_bias: FloatArray, found: ClosedForm
) -> InitialValues:
    """The linear solution, made upright."""
    bias, motion, upright = _by_imu(window, gyroscope_bias)
    up = gtsam.Unit3(-found.gravity)
    own_up = gtsam.Unit3(upright.unrotate(np.array([0.0, 0.0, 1.0])))
    attitude = upright.compose(_turn(up.point3(), own_up.point3()))
    velocity = attitude.rotate(found.velocity)
    poses = _poses(window, motion, attitude, velocity, bias)
    charts = []
    for line, along, moment in zip(window.seen, found.directions, found.moments, strict=True):
        camera = poses[line.frames[0]].compose(window.calibration.body_T_cam)
        points = line.sightings[0].points
        direction, moment = attitude.rotate(along), attitude.rotate(moment)
        # From the camera's centre to the line's next point, and along the ray to the line.
        foot = np.cross(direction, moment + np.cross(direction, camera.translation()))
        ray = camera.rotation().rotate(np.append(points.mean(axis=0), 1.0))
        depth = np.linalg.lstsq(np.column_stack([ray, -direction]), foot, rcond=None)[0][0]
        if _NEAR < depth < _FAR:
            through = np.cross(camera.translation() + foot, direction)
            charts.append(LineChart.from_plucker(camera, through, direction))
        else:
            charts.append(line_from_ruling(camera, points, 1.0 / _BETWEEN))
    return InitialValues(bias, upright, attitude, velocity, charts)


def _by_imu(
    window: FirstWindow, gyroscope_bias: FloatArray
) -> tuple[gtsam.imuBias.ConstantBias, FrameMotion, gtsam.Rot3]:
    """Bias, motion, and the attitude in which the window is upright on average: what velocity was
    gained meanwhile is its error.
    """
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyroscope_bias)
    motion = window.motion(bias)
    return bias, motion, level_attitude(motion.preintegrated[-1, 6:9])


def _poses(
    window: FirstWindow,
    motion: FrameMotion,
    attitude: gtsam.Rot3,
    velocity: FloatArray,
    bias: gtsam.imuBias.ConstantBias,
) -> list[gtsam.Pose3]:
    """world_T_body of the frames."""
    state = gtsam.NavState(gtsam.Pose3(attitude, np.zeros(3)), velocity)
    return motion.poses(state, bias, window.config.imu.gravity_in_world)


def _turn(one: FloatArray, other: FloatArray) -> gtsam.Rot3:
    """The shortest rotation that takes a unit vector onto another one."""
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, one @ other)
    return gtsam.Rot3.Expmap(axis * (angle / sine if sine > 0.0 else 0.0))
