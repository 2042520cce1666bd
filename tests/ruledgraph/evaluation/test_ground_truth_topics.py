# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth read from the topics of a recording."""

import numpy as np
import pytest

from ruledgraph.core.trajectory import TrajectoryError
from ruledgraph.evaluation.ground_truth import read_ground_truth
from truth_bags import (
    POSES,
    STAMPS,
    START,
    T,
    assert_the_two_poses,
    header,
    pose_message,
    write_bag,
)

POSE_TYPES = [
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
]


@pytest.mark.parametrize("kind", POSE_TYPES)
def test_topics_with_poses(tmp_path, kind):
    messages = [pose_message(kind, s, *pose) for s, pose in zip(STAMPS, POSES, strict=True)]
    recording = write_bag(tmp_path / "a.bag", {"/vicon/body": (kind, messages)})
    assert_the_two_poses(read_ground_truth("/vicon/body", recording))
    assert_the_two_poses(read_ground_truth("vicon/body", recording))


def test_topic_with_points(tmp_path):
    kind = "geometry_msgs/msg/PointStamped"
    messages = [pose_message(kind, s, *pose) for s, pose in zip(STAMPS, POSES, strict=True)]
    truth = read_ground_truth(
        "/leica/position", write_bag(tmp_path / "a.bag", {"/leica/position": (kind, messages)})
    )
    assert truth.quaternions is None
    np.testing.assert_array_equal(truth.positions, [p for p, _ in POSES])
    assert truth.stamps.tolist() == STAMPS


def test_frames_among_transforms(tmp_path):
    kind = "geometry_msgs/msg/TransformStamped"
    messages = [
        T["tf2_msgs/msg/TFMessage"](
            [
                pose_message(kind, stamp, [9.0, 9.0, 9.0], [0, 0, 0, 1], "wand"),
                pose_message(kind, stamp, *pose, "/vicon/body"),
            ]
        )
        for stamp, pose in zip(STAMPS, POSES, strict=True)
    ]
    recording = write_bag(tmp_path / "a.bag", {"/tf": ("tf2_msgs/msg/TFMessage", messages)})
    assert_the_two_poses(read_ground_truth("/tf:vicon/body", recording))
    for source, what in (("/tf", "holds the transforms of frames"), ("/tf:hat", "no frame hat")):
        with pytest.raises(TrajectoryError) as error:
            read_ground_truth(source, recording)
        choices = "/tf:vicon/body  or  /tf:wand"
        assert str(error.value) == f"{source}: {what}, choose one: {choices}"


def test_topics_without_ground_truth(tmp_path):
    kind = "geometry_msgs/msg/PoseStamped"
    topics = {
        "/pose": (kind, [pose_message(kind, START, *POSES[0])]),
        "/time": ("std_msgs/msg/Header", [header(START)]),
    }
    recording = write_bag(tmp_path / "a.bag", topics)
    with pytest.raises(TrajectoryError) as error:
        read_ground_truth("/none", recording)
    assert str(error.value) == "/none: is no file and no topic; topics with ground truth: /pose"
    with pytest.raises(TrajectoryError, match="/time: holds std_msgs/msg/Header, no poses; topics"):
        read_ground_truth("/time", recording)
