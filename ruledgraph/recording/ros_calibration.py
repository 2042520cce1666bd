# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a recording brings along, as ROS drivers publish it: the CameraInfo beside
the images, and the static transforms between the frames of camera and IMU.
"""

from collections.abc import Iterable
from typing import Any

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph.calibration import CalibrationError, camera_from_info
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.sensor_fields import LONGEST_LEVER
from ruledgraph.recording.container import Topic
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.recording import Recording
from ruledgraph.recording.topics import (
    CAMERA_INFO,
    STATIC_TRANSFORMS,
    TRANSFORMS,
    camera_info_topic,
    is_rectified,
)

# No robot has more frames; a quaternion further from unit is none.
_MAX_FRAMES = 10_000
_UNIT = 1e-3
# Axes that are turned against each other by more than this are not the same.
_SAME = 1e-3


def recorded_camera(recording: Recording) -> tuple[CameraModel, gtsam.Pose3]:
    """Camera model and body_T_cam from the recording's own `camera_info` and `/tf_static`.

    The frames are those that the headers name; the body is where the accelerometer is. A rectified
    image (`image_rect`) is described by the CameraInfo's projection matrix. Such figures are the
    maker's, or the robot's description, and say nothing of the time offset.

    Args:
        recording: with a camera's and an IMU's topic.

    Raises:
        RecordingError: when something of it was not recorded or makes no sense.
    """
    if recording.image_topic is None or recording.imu_topics is None:
        raise RecordingError("a recording without camera or IMU has no calibration of its own")
    image = recording.image_topic
    info_name = camera_info_topic(image.name)
    info = _first(recording, _named(recording, info_name, CAMERA_INFO))
    rectified = is_rectified(image.name)
    if rectified and _is_rotated(info.R if hasattr(info, "R") else info.r):
        raise RecordingError(
            f"{info_name}: turns its images in rectifying them (R is not the identity), and the "
            "frame of the headers may be that of the camera; record the images as they were taken"
        )
    try:
        camera = camera_from_info(info, rectified)
    except CalibrationError as error:
        raise RecordingError(f"{info_name}: {error}") from None
    static = _named(recording, STATIC_TRANSFORMS, TRANSFORMS)
    tree = _Tree(message for _, message in recording.messages(static.name))
    gyroscope, accelerometer = (
        _frame_of(topic.name, _first(recording, topic)) for topic in recording.imu_topics
    )
    if _is_rotated(tree.pose(accelerometer, gyroscope).rotation().matrix()):
        raise RecordingError(
            f"{STATIC_TRANSFORMS}: {_shown(gyroscope)} and {_shown(accelerometer)} are turned "
            "against each other; gyroscope and accelerometer must have the same axes"
        )
    body_T_cam = tree.pose(accelerometer, _frame_of(info_name, info))
    lever = float(np.abs(body_T_cam.translation()).max())
    if not lever <= LONGEST_LEVER:  # nor when it is not finite
        raise RecordingError(
            f"{STATIC_TRANSFORMS}: the camera is {lever:.3g} m from the IMU; it must be in metres"
        )
    return camera, body_T_cam


class _Tree:
    """Frames and where they are in their parents."""

    def __init__(self, messages: Iterable[Any]) -> None:
        self._parents: dict[str, tuple[str, gtsam.Pose3]] = {}
        for message in messages:
            for transform in message.transforms:
                child = transform.child_frame_id.strip("/")
                parent = transform.header.frame_id.strip("/")
                self._parents[child] = parent, _pose(child, transform.transform)
            if len(self._parents) > _MAX_FRAMES:
                raise RecordingError(f"{STATIC_TRANSFORMS}: more than {_MAX_FRAMES} frames")

    def pose(self, of: str, other: str) -> gtsam.Pose3:
        """of_T_other."""
        (root, root_T_of), (other_root, root_T_other) = self._in_root(of), self._in_root(other)
        if root != other_root:
            held = ", ".join(map(_shown, sorted(self._parents)[:20])) or "none"
            raise RecordingError(
                f"{STATIC_TRANSFORMS}: does not connect {_shown(of)} and {_shown(other)}; "
                f"frames: {held}"
            )
        return root_T_of.between(root_T_other)

    def _in_root(self, frame: str) -> tuple[str, gtsam.Pose3]:
        pose, passed = gtsam.Pose3(), set()
        while frame in self._parents:
            if frame in passed:
                raise RecordingError(f"{STATIC_TRANSFORMS}: {_shown(frame)} is its own parent")
            passed.add(frame)
            frame, in_parent = self._parents[frame]
            pose = in_parent.compose(pose)
        return frame, pose


def _pose(frame: str, transform: Any) -> gtsam.Pose3:
    t, q = transform.translation, transform.rotation
    place, quaternion = np.array([t.x, t.y, t.z]), np.array([q.w, q.x, q.y, q.z])
    # Not finite compares false; the norm of what is very large would overflow.
    small = np.abs(quaternion).max() <= 2.0 and np.isfinite(place).all()
    if not (small and abs(np.linalg.norm(quaternion) - 1.0) < _UNIT):
        raise RecordingError(f"{STATIC_TRANSFORMS}: the transform of {_shown(frame)} is no pose")
    return gtsam.Pose3(gtsam.Rot3.Quaternion(*(quaternion / np.linalg.norm(quaternion))), place)


def _is_rotated(rotation: ArrayLike) -> bool:
    """Whether it is not the identity; all zero in a CameraInfo says nothing."""
    R = np.reshape(np.asarray(rotation, dtype=np.float64), (3, 3))
    return bool(R.any() and not np.abs(R - np.eye(3)).max() <= _SAME)


def _named(recording: Recording, name: str, kind: str) -> Topic:
    topics = [topic for topic in recording.topics if topic.name == name and topic.message_count]
    if not topics:
        raise RecordingError(f"{name} was not recorded")
    if [topic.type for topic in topics] != [kind]:
        kinds = ", ".join(topic.type for topic in topics)
        raise RecordingError(f"{name}: must be of type {kind}, but is {kinds}")
    return topics[0]


def _first(recording: Recording, topic: Topic) -> Any:
    for _, message in recording.messages(topic.name):
        return message
    raise RecordingError(f"{topic.name}: holds no message that can be read and has a stamp")


def _frame_of(topic: str, message: Any) -> str:
    frame: str = message.header.frame_id.strip("/")
    if not frame:
        raise RecordingError(f"{topic}: its messages name no frame")
    return frame


def _shown(name: str) -> str:
    return repr(name[:40])
