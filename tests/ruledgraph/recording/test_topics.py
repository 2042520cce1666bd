# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Topics found by type; several are listed as flags to paste."""

import pytest

from ruledgraph.recording import RecordingError, Topic
from ruledgraph.recording.topics import (
    camera_info_topic,
    choose_image_topic,
    choose_imu_topics,
)


def image(name: str, count: int = 5) -> Topic:
    return Topic(name, "sensor_msgs/msg/Image", "cdr", count)


def imu(name: str, count: int = 5) -> Topic:
    return Topic(name, "sensor_msgs/msg/Imu", "cdr", count)


REALSENSE = [imu("/camera/gyro/sample"), imu("/camera/accel/sample")]
LIBREALSENSE = [
    imu("/device_0/sensor_2/Gyro_0/imu/data"),
    imu("/device_0/sensor_2/Accel_0/imu/data"),
]
POSE = Topic("/pose", "geometry_msgs/msg/PoseStamped", "cdr", 3)


def test_the_only_one_is_used() -> None:
    topics = [image("/a"), image("/empty", 0), imu("/b"), POSE]
    assert choose_image_topic(topics) == topics[0]
    assert choose_imu_topics(topics) == (topics[2], topics[2])
    assert not choose_imu_topics(topics).split


@pytest.mark.parametrize("pair", [REALSENSE, LIBREALSENSE])
def test_a_gyroscope_and_an_accelerometer_make_an_imu(pair: list[Topic]) -> None:
    chosen = choose_imu_topics([*pair, POSE])
    assert chosen == (pair[0], pair[1])
    assert chosen.split
    # A whole one is preferred.
    whole = imu("/camera/imu")
    assert choose_imu_topics([*pair, whole]) == (whole, whole)
    assert choose_imu_topics([*pair, whole], gyroscope=pair[0].name).split
    assert choose_imu_topics(pair, imu=pair[0].name) == (pair[0], pair[0])


def test_several_are_listed_as_flags() -> None:
    with pytest.raises(RecordingError) as caught:
        choose_image_topic([image("/cam0"), image("/cam1")])
    assert str(caught.value) == (
        "several topics hold images, choose with: --image-topic /cam0 or --image-topic /cam1"
    )
    with pytest.raises(RecordingError, match="--imu-topic /imu0 or --imu-topic /mavros/imu"):
        choose_imu_topics([imu("/imu0"), imu("/mavros/imu")])
    with pytest.raises(RecordingError) as caught:
        choose_imu_topics([*REALSENSE, *LIBREALSENSE])
    for pair in (REALSENSE, LIBREALSENSE):
        assert f"--gyroscope-topic {pair[0].name}" in str(caught.value)
        assert f"--accelerometer-topic {pair[1].name}" in str(caught.value)


def test_the_leading_slash_may_be_left_out() -> None:
    assert choose_image_topic([image("/cam0"), image("/cam1")], "cam1").name == "/cam1"


@pytest.mark.parametrize(
    ("topics", "text"),
    [
        ([POSE], r"no camera: no topic with images \(topics: /pose\)"),
        ([], r"no camera: no topic with images \(it holds no messages\)"),
    ],
)
def test_no_camera(topics: list[Topic], text: str) -> None:
    with pytest.raises(RecordingError, match=text):
        choose_image_topic(topics)


def test_no_imu() -> None:
    with pytest.raises(RecordingError, match=r"no IMU: no topic with IMU samples \(topics: /a\)"):
        choose_imu_topics([image("/a")])
    with pytest.raises(RecordingError, match="/camera/gyro/sample is but half of one"):
        choose_imu_topics(REALSENSE[:1])


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        ("/nowhere", r"no topic named '/nowhere' \(topics: /cam0, /imu0\)"),
        ("/imu0", "is of type sensor_msgs/msg/Imu, it holds no images; use one of: --image-topic"),
        ("/empty", "/empty has no messages, it holds no images"),
    ],
)
def test_a_wrong_choice(wanted: str, text: str) -> None:
    with pytest.raises(RecordingError, match=text):
        choose_image_topic([image("/cam0"), image("/empty", 0), imu("/imu0")], wanted)


def test_contradicting_flags() -> None:
    with pytest.raises(RecordingError, match="--imu-topic excludes"):
        choose_imu_topics(REALSENSE, imu="/imu0", gyroscope="/camera/gyro/sample")
    with pytest.raises(RecordingError, match="name the accelerometer's topic too"):
        choose_imu_topics([imu("/a"), imu("/b")], gyroscope="/a")


@pytest.mark.parametrize(
    "topic",
    ["/camera/color/image_raw", "/camera/color/image_raw/compressed"],
)
def test_camera_info_lies_beside_the_images(topic: str) -> None:
    assert camera_info_topic(topic) == "/camera/color/camera_info"
