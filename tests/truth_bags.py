# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Two poses of ground truth, and bags with poses, points and markers."""

from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.recording import Recording
from ruledgraph.recording.formats import open_container

HALF = np.sqrt(0.5)
START = 1403636584663560000
# Two poses: position, quaternion x, y, z, w.
POSES = [([1.0, 2.0, 3.0], [0.0, 0.0, HALF, HALF]), ([1.5, 2.5, 3.5], [0.6, 0.0, 0.0, 0.8])]
STAMPS = [START, START + 5_000_001]


def assert_the_two_poses(truth: GroundTruth, stamps=STAMPS, atol: float = 1e-15) -> None:
    assert truth.stamps.tolist() == list(stamps)
    np.testing.assert_allclose(truth.positions, [p for p, _ in POSES], atol=atol)
    np.testing.assert_allclose(truth.quaternions, [q for _, q in POSES], atol=atol)
    assert (truth.dropped, truth.repeated) == (0, 0)


STORE = get_typestore(Stores.ROS1_NOETIC)
for name, definition in {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "vicon_bridge/msg/Marker": "string marker_name\nstring subject_name\nstring segment_name\n"
    "geometry_msgs/Point translation\nbool occluded",
    "vicon_bridge/msg/Markers": "Header header\nuint32 frame_number\nMarker[] markers",
}.items():
    STORE.register(get_types_from_msg(definition, name))
T = STORE.types


def header(stamp: int):
    time = T["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    return T["std_msgs/msg/Header"](0, time, "world")


def pose_message(kind: str, stamp: int, p, q, child: str = "body"):
    point, quaternion = T["geometry_msgs/msg/Point"](*p), T["geometry_msgs/msg/Quaternion"](*q)
    pose = T["geometry_msgs/msg/Pose"](point, quaternion)
    covered = T["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    if kind == "nav_msgs/msg/Odometry":
        zero = T["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = T["geometry_msgs/msg/Twist"](zero, zero)
        twist = T["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
        return T[kind](header(stamp), child, covered, twist)
    if kind == "geometry_msgs/msg/TransformStamped":
        vector = T["geometry_msgs/msg/Vector3"](*p)
        transform = T["geometry_msgs/msg/Transform"](vector, quaternion)
        return T[kind](header(stamp), child, transform)
    body = {"PoseStamped": pose, "PoseWithCovarianceStamped": covered, "PointStamped": point}
    return T[kind](header(stamp), body[kind.rsplit("/", 1)[1]])


def write_bag(path: Path, topics: dict[str, tuple[str, list]]) -> Recording:
    """A bag whose messages were received a second after their headers' stamps."""
    with Rosbag1Writer(path) as writer:
        for name, (kind, messages) in topics.items():
            connection = writer.add_connection(name, kind, typestore=STORE)
            for i, message in enumerate(messages):
                data = STORE.serialize_ros1(message, kind)
                writer.write(connection, START + 10**9 + i, data)
    return Recording(open_container(path), None, None)
