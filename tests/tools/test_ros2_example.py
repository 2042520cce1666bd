# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The example for ROS 2. ROS is not here: a stand-in with rclpy's names takes its place."""

import importlib
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from ruledgraph.core.measurements import Frame, ImuSample
from small_simulation import small_stream


class StandInNode:
    def __init__(self, _name: str) -> None:
        self.published: list = []
        self.subscriptions_by_topic: dict = {}

    def create_publisher(self, _type, _topic: str, _depth: int):
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, _type, topic: str, callback, _qos) -> None:
        self.subscriptions_by_topic[topic] = callback


def pose_message():
    pose = SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace())
    return SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace()), pose=pose)


def header(stamp: int):
    sec, nanosec = divmod(stamp, 10**9)
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))


def vector(values: np.ndarray):
    return SimpleNamespace(**dict(zip("xyz", map(float, values), strict=True)))


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch):
    for name, contents in {
        "rclpy": {},
        "rclpy.node": {"Node": StandInNode},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"PoseStamped": pose_message},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": object, "Imu": object},
    }.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "ros2_example", raising=False)
    return importlib.import_module("ros2_example")


def test_poses_come_of_messages(example):
    stream, calibration = small_stream()
    # They come at once: all images have to wait.
    node = example.OdometryNode(calibration)
    node.odometry._queue._max_frames = len(stream)
    with node.odometry:
        for item in stream:
            if isinstance(item, Frame):
                height, width = item.image.shape
                padded = np.pad(item.image, ((0, 0), (0, 8)))
                message = SimpleNamespace(
                    header=header(item.stamp), height=height, width=width, step=width + 8
                )
                message.encoding, message.data = "mono8", padded.tobytes()
                node.subscriptions_by_topic["image"](message)
            elif isinstance(item, ImuSample):
                message = SimpleNamespace(header=header(item.stamp))
                message.angular_velocity = vector(item.gyroscope)
                message.linear_acceleration = vector(item.accelerometer)
                node.subscriptions_by_topic["imu"](message)
    stamps = {item.stamp for item in stream if isinstance(item, Frame)}
    assert len(node.published) > 0.8 * len(stamps)
    last = node.published[-1]
    assert last.header.stamp.sec * 10**9 + last.header.stamp.nanosec in stamps
    assert last.header.frame_id == "odom"
    turned = last.pose.orientation
    assert np.linalg.norm([turned.x, turned.y, turned.z, turned.w]) == pytest.approx(1.0)
