# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is known of a frame before it is looked at."""

from ruledgraph.frontend.front_end import FramePrediction
from ruledgraph.frontend.ruling_prediction import CameraMotion
from ruledgraph.imu.propagation import rotation_between
from ruledgraph.segments.segment import TrajectorySegment
from ruledgraph.stages import Stages
from ruledgraph.synchronization.frame_history import FrameTime


def frame_prediction(
    stages: Stages, segment: TrajectorySegment | None, now: FrameTime
) -> FramePrediction | None:
    """The camera's motion since the last frame, and the lines of the graph; None for the first
    frame.
    """
    synchronizer, body_T_cam = stages.synchronizer, stages.online_calibration.current.body_T_cam
    if not synchronizer.frames:
        return None
    before = synchronizer.frames.last
    elapsed = now.time - before.time
    if segment is None:
        body_R_cam = body_T_cam.rotation()
        before_R_body = rotation_between(synchronizer.imu, before.time, now.time)
        R = body_R_cam.matrix().T @ before_R_body.matrix().T @ body_R_cam.matrix()
        rotation_only = CameraMotion(
            R, elapsed, body_T_cam, body_T_cam, stages.online_calibration.ratio
        )
        return FramePrediction(rotation_only, {})
    body_T_cam, rest, window = segment.body_T_cam, segment.rest_phase, segment.window
    world_T_before = rest.held(segment.state, window).pose().compose(body_T_cam)
    world_T_cam = rest.held(segment.predict(now.time), window).pose().compose(body_T_cam)
    R = world_T_cam.between(world_T_before).rotation().matrix()
    motion = CameraMotion(R, elapsed, world_T_before, world_T_cam, focal_ratio(stages, segment))
    # Where the IMU was unreliable, tracks are predicted by their own motion in the image.
    lines = {} if segment.is_motion_unreliable(now.time) else window.lines
    return FramePrediction(motion, {id_: line.prediction() for id_, line in lines.items()})


def focal_ratio(stages: Stages, segment: TrajectorySegment | None) -> float:
    """Focal length over the calibration's, by the segment's window or else as last known."""
    found = None if segment is None else segment.window.self_calibration.focal_ratio
    return stages.online_calibration.ratio if found is None else found.value
