# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded messages made into stamps, samples and message objects.

Types are rosbags' own definitions of the standard ROS messages, never the definitions embedded in
a recording.
"""

import struct
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ruledgraph.recording.container import RawMessage, Topic
from ruledgraph.recording.errors import RecordingError

# Messages beside the standard ones: tf, and the markers of ethz-asl's vicon_bridge.
_MORE_MESSAGES = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms",
    "vicon_bridge/msg/Marker": (
        "string marker_name\nstring subject_name\nstring segment_name\n"
        "geometry_msgs/Point translation\nbool occluded"
    ),
    "vicon_bridge/msg/Markers": (
        "std_msgs/Header header\nuint32 frame_number\nvicon_bridge/Marker[] markers"
    ),
}


class UnreadableMessageError(Exception):
    """One message that cannot be used; the others may be good."""


@cache
def types(*, ros1: bool) -> Typestore:
    """The messages of ROS 1 or ROS 2; each takes a tenth of a second to load."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, definition in _MORE_MESSAGES.items():
        store.register(get_types_from_msg(definition, name))
    return store


def stamp_of(topic: Topic, message: RawMessage) -> int:
    """The stamp in a message's header, ns, without decoding the rest.

    Of a type without header, the time of reception.

    Raises:
        UnreadableMessageError: for a message that is too short, or has no stamp: zero or less.
    """
    data = message.data
    if isinstance(data, bytes) and has_header(topic):
        try:
            if topic.encoding == "ros1":
                _, seconds, nanoseconds = struct.unpack_from("<III", data)
            else:
                order = "<" if data[1] & 1 else ">"
                seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
        except (struct.error, IndexError):
            raise UnreadableMessageError("cut") from None
        if nanoseconds >= 10**9:
            raise UnreadableMessageError("its stamp makes no sense")
        stamp = int(seconds * 10**9 + nanoseconds)
    else:
        stamp = message.received
    if not 0 < stamp < 2**63:
        raise UnreadableMessageError("it has no stamp")
    return stamp


def has_header(topic: Topic) -> bool:
    """Whether messages of this type begin with a `std_msgs/Header`."""
    definition = types(ros1=topic.encoding == "ros1").fielddefs.get(topic.type)
    return bool(definition and definition[1] and "std_msgs/msg/Header" in definition[1][0][1])


def deserialise(topic: Topic, data: bytes) -> Any:
    """A message as rosbags' object of its type.

    Raises:
        UnreadableMessageError: when the bytes are not a message of this type.
        RecordingError: for a type that is not a standard one.
    """
    store = types(ros1=topic.encoding == "ros1")
    if topic.type not in store.fielddefs or topic.encoding not in ("ros1", "cdr"):
        raise RecordingError(
            f"topic {topic.name}: messages of type {topic.type!r} ({topic.encoding}) are not known"
        )
    try:
        if topic.encoding == "ros1":
            return store.deserialize_ros1(data, topic.type)
        return store.deserialize_cdr(data, topic.type)
    except (SerdeError, ValueError, IndexError, struct.error, AssertionError) as error:
        raise UnreadableMessageError(f"it cannot be decoded ({type(error).__name__})") from None


def inertial_vectors(topic: Topic, data: bytes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular velocity and linear acceleration, (3,) each, of an IMU message.

    Raises:
        UnreadableMessageError: when the bytes are not such a message.
    """
    if topic.encoding == "asl":
        try:
            row = np.array(data.decode().split(","), dtype=np.float64)
        except (ValueError, UnicodeDecodeError):
            raise UnreadableMessageError("a row is not made of numbers") from None
        if row.shape != (6,):
            raise UnreadableMessageError(f"a row has {row.size} numbers after the stamp, not 6")
        return row[:3], row[3:]
    message = deserialise(topic, data)
    w, a = message.angular_velocity, message.linear_acceleration
    return np.array([w.x, w.y, w.z]), np.array([a.x, a.y, a.z])
