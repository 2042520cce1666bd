# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What every kind of recording offers: its topics and their messages, not yet decoded."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, TypeAlias

Kind: TypeAlias = Literal["rosbag1", "rosbag2", "mcap", "asl"]
"""`mcap` is a single MCAP file; a folder of them is a `rosbag2`."""

MAX_BLOCK = 2**30
"""Bytes; sizes in a file beyond this are taken for damage and nothing is allocated for them."""


class Topic(NamedTuple):
    """Messages of one name and type; types are spelt as in ROS 2, `sensor_msgs/msg/Imu`."""

    name: str
    type: str
    encoding: str
    """`ros1` or `cdr`, how messages are serialised; `asl` for a folder's files."""
    message_count: int


class RawMessage(NamedTuple):
    """A message as it was recorded."""

    received: int
    """When it was recorded, ns; nothing but a hint at the order."""
    topic: str
    data: bytes | Path
    """The serialised message, or the file that holds it."""


class Container(Protocol):
    """A recording, opened. Files are only held open while messages are read."""

    kind: Kind
    topics: list[Topic]
    damage: dict[str, int]
    """What is damaged -> bytes that could not be read for it; grows while messages are read."""

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """The messages of these topics, in the order in which they were received."""
        ...


def merge_topics(topics: Collection[Topic]) -> list[Topic]:
    """One topic for each name and type, the counts added, sorted by name."""
    merged: dict[tuple[str, str, str], int] = {}
    for topic in topics:
        merged[topic[:3]] = merged.get(topic[:3], 0) + topic.message_count
    return [Topic(*key, count) for key, count in sorted(merged.items())]


def printable(name: str) -> str:
    """A name with its control characters escaped as Python does it."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)


def first_of(damage: dict[str, int]) -> str:
    """The first damage, to append to a message that it may explain."""
    return f"; {next(iter(damage))}" if damage else ""
