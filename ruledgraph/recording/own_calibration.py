# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a recording brings along, as ROS drivers publish it: the CameraInfo beside
the images, and the static transforms between the frames of camera and IMU.
"""

from collections.abc import Iterable
from typing import Any

import gtsam
import numpy as np

from ruledgraph.calibration import CalibrationError, camera_from_info
from ruledgraph.recording.container import Topic
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.recording import Recording
from ruledgraph.recording.topics import CAMERA_INFO, camera_info_topic, is_rectified
from ruledgraph.sensors import Calibration, ImuNoise

_TRANSFORMS = "tf2_msgs/msg/TFMessage"
# No robot has more; a quaternion further from unit is none.
_MOST_FRAMES = 10_000
_UNIT = 1e-3
# Gyroscope and accelerometer turned against each other by more than this (rad) are not one IMU.
_SAME = 1e-3


def recorded_calibration(recording: Recording, imu_noise: ImuNoise) -> Calibration:
    """Camera model and mounting from the recording's own `camera_info` and `/tf_static`.

    The frames are those that the headers name. A rectified image (`image_rect`) is described by the
    CameraInfo's projection matrix. Such figures are the maker's, or the robot's description, and
    say nothing of the time offset.

    Args:
        recording: with a camera's and an IMU's topic.
        imu_noise: which no message tells.

    Raises:
        RecordingError: when something of it was not recorded, or the frames are not connected.
    """
    if recording.image_topic is None or recording.imu_topics is None:
        raise RecordingError("a recording without camera or IMU has no calibration of its own")
    image = recording.image_topic
    info_name = camera_info_topic(image.name)
    info = _first(recording, _named(recording, info_name, CAMERA_INFO))
    try:
        camera = camera_from_info(info, is_rectified(image.name))
    except CalibrationError as error:
        raise RecordingError(f"{info_name}: {error}") from None
    static = _named(recording, "/tf_static", _TRANSFORMS)
    tree = _Tree(message for _, message in recording.messages(static.name))
    camera_frame = _frame_of(info_name, info)
    gyroscope, accelerometer = (
        _frame_of(topic.name, _first(recording, topic)) for topic in recording.imu_topics
    )
    turned = tree.pose(gyroscope, accelerometer).rotation()
    if np.linalg.norm(gtsam.Rot3.Logmap(turned)) > _SAME:
        raise RecordingError(
            f"/tf_static: {gyroscope} and {accelerometer} are turned against each other; they must "
            "have the same axes"
        )
    return Calibration(camera, tree.pose(gyroscope, camera_frame), imu_noise)


class _Tree:
    """Frames and where they are in their parents."""

    def __init__(self, messages: Iterable[Any]) -> None:
        self._parents: dict[str, tuple[str, gtsam.Pose3]] = {}
        for message in messages:
            for transform in message.transforms:
                child = transform.child_frame_id.strip("/")
                parent = transform.header.frame_id.strip("/")
                self._parents[child] = parent, _pose(child, transform.transform)
            if len(self._parents) > _MOST_FRAMES:
                raise RecordingError(f"/tf_static: more than {_MOST_FRAMES} frames")

    def pose(self, of: str, other: str) -> gtsam.Pose3:
        """of_T_other."""
        if of == other:
            return gtsam.Pose3()
        (root, root_T_of), (other_root, root_T_other) = self._in_root(of), self._in_root(other)
        if root != other_root:
            raise RecordingError(
                f"/tf_static: does not connect {of} and {other}; it holds the frames "
                f"{', '.join(sorted(self._parents)[:20]) or 'of nothing'}"
            )
        return root_T_of.between(root_T_other)

    def _in_root(self, frame: str) -> tuple[str, gtsam.Pose3]:
        pose, passed = gtsam.Pose3(), set()
        while frame in self._parents:
            if frame in passed:
                raise RecordingError(f"/tf_static: the frame {frame} is its own parent")
            passed.add(frame)
            frame, in_parent = self._parents[frame]
            pose = in_parent.compose(pose)
        return frame, pose


def _pose(frame: str, transform: Any) -> gtsam.Pose3:
    t, q = transform.translation, transform.rotation
    numbers = np.array([t.x, t.y, t.z, q.w, q.x, q.y, q.z])
    # Not finite compares false.
    if not (np.isfinite(numbers).all() and abs(np.linalg.norm(numbers[3:]) - 1.0) < _UNIT):
        raise RecordingError(f"/tf_static: the transform of {frame} is no pose")
    rotation = gtsam.Rot3.Quaternion(*(numbers[3:] / np.linalg.norm(numbers[3:])))
    return gtsam.Pose3(rotation, numbers[:3])


def _named(recording: Recording, name: str, kind: str) -> Topic:
    for topic in recording.topics:
        if topic.name == name and topic.type == kind and topic.message_count:
            return topic
    raise RecordingError(f"{name} was not recorded")


def _first(recording: Recording, topic: Topic) -> Any:
    for _, message in recording.messages(topic.name):
        return message
    raise RecordingError(f"{topic.name}: holds no message that can be read")


def _frame_of(topic: str, message: Any) -> str:
    frame: str = message.header.frame_id.strip("/")
    if not frame:
        raise RecordingError(f"{topic}: its messages name no frame")
    return frame
