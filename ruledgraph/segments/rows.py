# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How the camera moves while a rolling shutter reads an image, by the IMU and the estimate."""

from dataclasses import replace

import gtsam
import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.frontend.row_motion import RowMotion
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import state_before
from ruledgraph.segments.frame_prediction import focal_ratio
from ruledgraph.segments.segment import TrajectorySegment
from ruledgraph.stages import Stages
from ruledgraph.synchronization.frame_history import FrameTime
from ruledgraph_factors import preintegrate_frames

# Of the grid of rows, the middle one among them. Of a readout of 30 ms they are 4 ms apart, about
# as IMU samples are.
_ROWS = 9
_NO_BIAS = gtsam.imuBias.ConstantBias()


def row_motion(
    stages: Stages, segment: TrajectorySegment | None, now: FrameTime
) -> RowMotion | None:
    """The camera's motion during a frame, after `predicted`; None of a global shutter."""
    imu, online_calibration = stages.synchronizer.imu, stages.online_calibration
    half = 0.5 * online_calibration.current.readout
    if not (half and imu.covers(now.time - half, now.time + half)):
        return None
    calibration = replace(online_calibration.current, camera=online_calibration.camera)
    state, bias, ratio = None, _NO_BIAS, focal_ratio(stages, segment)
    if segment is not None:
        window = segment.window
        state, bias = segment.rest_phase.held(segment.state, window), window.newest.bias
    return motion_about(calibration, imu, now.time, state, bias, ratio)


def motion_about(
    calibration: Calibration,
    imu: ImuBuffer,
    time: float,
    state: gtsam.NavState | None,
    bias: gtsam.imuBias.ConstantBias,
    focal_ratio: float = 1.0,
) -> RowMotion:
    """The camera's motion about the middle row.

    Args:
        calibration: with a readout, and the camera that points are undistorted by.
        imu: samples from the first row's time to the last's.
        time: of the middle row, s.
        state: of the body at that time; None before a start, when only the rotation is known.
        bias: of the IMU.
        focal_ratio: of the camera's focal length to the calibration's.
    """
    half = 0.5 * calibration.readout
    times = np.linspace(-half, half, _ROWS)
    at = time + times
    first = gtsam.NavState() if state is None else state_before(imu, state, bias, time, half)
    motion = preintegrate_frames(imu.between(at[0], at[-1]), at[0], at, bias)
    bodies = motion.poses(first, bias, imu.gravity)
    cameras = [pose.compose(calibration.body_T_cam) for pose in bodies]
    middle = cameras[_ROWS // 2]
    relative = [middle.between(camera) for camera in cameras]
    return RowMotion(
        camera=calibration.camera,
        focal_ratio=focal_ratio,
        line_delay=calibration.line_delay or 0.0,
        times=times,
        turns=np.array([gtsam.Rot3.Logmap(pose.rotation()) for pose in relative]),
        positions=None if state is None else np.array([p.translation() for p in relative]),
    )
