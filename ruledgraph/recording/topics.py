# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Which topics to use: those asked for, or the only ones that fit."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

from ruledgraph.recording import asl
from ruledgraph.recording.container import Topic
from ruledgraph.recording.errors import RecordingError

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", asl.IMAGE)
IMU_TYPES = ("sensor_msgs/msg/Imu", asl.IMU)
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
STATIC_TRANSFORMS, TRANSFORMS = "/tf_static", "tf2_msgs/msg/TFMessage"


class ImuTopics(NamedTuple):
    """One topic with both vectors, or the gyroscope's and the accelerometer's."""

    gyroscope: Topic
    accelerometer: Topic

    @property
    def split(self) -> bool:
        """Whether the two vectors come on topics of their own."""
        return self.gyroscope != self.accelerometer


def choose_image_topic(topics: Collection[Topic], wanted: str | None = None) -> Topic:
    """The camera's topic: the wanted one, or the only one with images.

    Raises:
        RecordingError: when there is none, or there are several to choose from.
    """
    images = _of_type(topics, IMAGE_TYPES)
    if wanted is not None:
        return _named(topics, images, wanted, "--image-topic", "images")
    if not images:
        raise RecordingError(f"no camera: no topic with images ({_listing(topics)})")
    if len(images) > 1:
        raise _several("images", [f"--image-topic {topic.name}" for topic in images])
    return images[0]


def choose_imu_topics(
    topics: Collection[Topic],
    imu: str | None = None,
    gyroscope: str | None = None,
    accelerometer: str | None = None,
) -> ImuTopics:
    """The IMU's topic or topics: those wanted, or the only ones that fit.

    Topics whose names hold "gyro" or "accel" are taken for half an IMU each.

    Raises:
        RecordingError: when there is none, or there are several to choose from, or one topic and
            a pair are both asked for.
    """
    candidates = _of_type(topics, IMU_TYPES)
    if imu is not None and (gyroscope is not None or accelerometer is not None):
        raise RecordingError("--imu-topic excludes --gyroscope-topic and --accelerometer-topic")
    if imu is not None:
        topic = _named(topics, candidates, imu, "--imu-topic", "IMU samples")
        return ImuTopics(topic, topic)
    gyroscopes = [topic for topic in candidates if "gyro" in topic.name.lower()]
    accelerometers = [topic for topic in candidates if "accel" in topic.name.lower()]
    whole = [t for t in candidates if (t in gyroscopes) == (t in accelerometers)]
    if gyroscope is not None or accelerometer is not None:
        return ImuTopics(
            _half(topics, candidates, gyroscopes, gyroscope, "gyroscope"),
            _half(topics, candidates, accelerometers, accelerometer, "accelerometer"),
        )
    if len(whole) == 1:
        return ImuTopics(whole[0], whole[0])
    if not whole and len(gyroscopes) == 1 and len(accelerometers) == 1:
        return ImuTopics(gyroscopes[0], accelerometers[0])
    if not candidates:
        raise RecordingError(f"no IMU: no topic with IMU samples ({_listing(topics)})")
    if len(candidates) == 1:
        raise RecordingError(
            f"no whole IMU: {candidates[0].name} is but half of one; "
            f"if it holds both vectors, use --imu-topic {candidates[0].name}"
        )
    flags = [f"--imu-topic {topic.name}" for topic in whole]
    flags += [f"--gyroscope-topic {topic.name}" for topic in gyroscopes if topic not in whole]
    flags += [
        f"--accelerometer-topic {topic.name}" for topic in accelerometers if topic not in whole
    ]
    raise _several("IMU samples", flags)


def camera_info_topic(image_topic: str) -> str:
    """Where ROS drivers publish the CameraInfo of an image topic: beside it."""
    namespace = image_topic.removesuffix("/compressed").rpartition("/")[0]
    return f"{namespace}/camera_info"


def is_rectified(image_topic: str) -> bool:
    """Whether its images are rectified, as ROS names them: `image_rect`, `image_rect_color`, ..."""
    return image_topic.removesuffix("/compressed").rpartition("/")[2].startswith("image_rect")


def find_topic(topics: Collection[Topic], name: str) -> Topic:
    """The topic of a name, with or without its leading slash.

    Raises:
        RecordingError: when there is none.
    """
    for topic in topics:
        if topic.name.strip("/") == name.strip("/"):
            return topic
    raise RecordingError(f"no topic named {name!r} ({_listing(topics)})")


def _half(
    topics: Collection[Topic],
    candidates: Sequence[Topic],
    by_name: Sequence[Topic],
    wanted: str | None,
    sensor: str,
) -> Topic:
    if wanted is not None:
        return _named(topics, candidates, wanted, f"--{sensor}-topic", "IMU samples")
    if len(by_name) == 1:
        return by_name[0]
    if by_name:
        raise _several(f"{sensor} samples", [f"--{sensor}-topic {topic.name}" for topic in by_name])
    raise RecordingError(f"name the {sensor}'s topic too: --{sensor}-topic")


def _of_type(topics: Collection[Topic], types: Collection[str]) -> list[Topic]:
    return [topic for topic in topics if topic.type in types and topic.message_count]


def _named(
    topics: Collection[Topic], fitting: Sequence[Topic], wanted: str, flag: str, what: str
) -> Topic:
    topic = find_topic(topics, wanted)
    if topic in fitting:
        return topic
    why = f"is of type {topic.type}" if topic.message_count else "has no messages"
    instead = f"; use one of: {_join([f'{flag} {t.name}' for t in fitting])}" if fitting else ""
    raise RecordingError(f"topic {topic.name} {why}, it holds no {what}{instead}")


def _several(what: str, flags: Sequence[str]) -> RecordingError:
    return RecordingError(f"several topics hold {what}, choose with: {_join(flags)}")


def _join(flags: Sequence[str]) -> str:
    return " or ".join(flags)


def _listing(topics: Collection[Topic]) -> str:
    names = [topic.name for topic in topics if topic.message_count]
    return f"topics: {', '.join(names)}" if names else "it holds no messages"
