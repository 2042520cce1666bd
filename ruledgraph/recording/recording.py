# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A recording as a stream of frames and IMU samples."""

import math
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

from ruledgraph.core.measurements import Measurement
from ruledgraph.recording.container import Container, Kind, Topic, first_of
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.formats import open_container
from ruledgraph.recording.images import decode_image
from ruledgraph.recording.messages import UnreadableMessageError, deserialise, stamp_of
from ruledgraph.recording.report import Report
from ruledgraph.recording.stream import Decoder, Source, read_stream
from ruledgraph.recording.topics import (
    ImuTopics,
    choose_image_topic,
    choose_imu_topics,
    find_topic,
)


def open_recording(
    path: str | PathLike[str],
    *,
    image_topic: str | None = None,
    imu_topic: str | None = None,
    gyroscope_topic: str | None = None,
    accelerometer_topic: str | None = None,
    start: float | None = None,
    duration: float | None = None,
) -> "Recording":
    """Open a ROS 1 bag, ROS 2 bag, MCAP file or ASL folder, told apart by their contents.

    Args:
        path: the file or folder.
        image_topic: the camera's topic; needed when several hold images.
        imu_topic: the IMU's topic; needed when several hold IMU samples.
        gyroscope_topic: the gyroscope's topic, when the accelerometer has one of its own.
        accelerometer_topic: the accelerometer's.
        start: s after the first message of these topics to begin at.
        duration: s to read from there on.

    Raises:
        RecordingError: for a recording that cannot be read, that lacks a camera or an IMU, or has
            several and none is chosen.
    """
    container = open_container(Path(path))
    try:
        camera = choose_image_topic(container.topics, image_topic)
        imu = choose_imu_topics(container.topics, imu_topic, gyroscope_topic, accelerometer_topic)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}{first_of(container.damage)}") from None
    return Recording(container, camera, imu, start, duration)


class Recording:
    """A recording, the topics chosen from it, and the stretch of time to read.

    Without a camera's or an IMU's topic the stream holds the other's measurements alone.
    """

    def __init__(
        self,
        container: Container,
        image_topic: Topic | None,
        imu_topics: ImuTopics | None,
        start: float | None = None,
        duration: float | None = None,
    ) -> None:
        for name, value, positive in (("start", start, False), ("duration", duration, True)):
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise RecordingError(f"{name} must be a number of seconds, got {value}")
            if positive and value == 0.0:
                raise RecordingError(f"{name} must be positive")
        self._container = container
        self._source = Source(container, image_topic, imu_topics, start or 0.0, duration)
        self.kind: Kind = container.kind
        self.topics: list[Topic] = container.topics
        self.image_topic = image_topic
        self.imu_topics = imu_topics
        self.report = Report(damage=container.damage)
        """Of the latest pass; filled while its stream is consumed."""

    def stream(self, *, keep_encoded: bool = False) -> Iterator[Measurement]:
        """Frames and IMU samples in the order of their stamps, in one pass.

        A message may come up to `REORDER_BOUND` late. Damaged, repeated and late messages are
        left out and counted in `report`. Every call begins a new pass, with a new `report`.

        Args:
            keep_encoded: frames keep the PNG or JPEG they were recorded as.

        Raises:
            RecordingError: when nothing usable is found, the camera's and the IMU's stamps do not
                overlap, or the frames' size changes.
        """
        self.report = Report(damage=self._container.damage)
        return read_stream(
            self._source._replace(keep_encoded=keep_encoded), decode_image, self.report
        )

    def stream_with(self, decode: Decoder) -> Iterator[Measurement]:
        """As `stream`, with another way to make images of messages."""
        self.report = Report(damage=self._container.damage)
        return read_stream(self._source, decode, self.report)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Messages of any topic in the order of their reception, with the stamps of their headers.

        They are objects of rosbags' classes. Ones that cannot be decoded are left out.

        Raises:
            RecordingError: for a topic that is not there, or not of a standard type.
        """
        chosen = find_topic(self.topics, topic)
        try:
            for raw in self._container.messages([chosen.name]):
                if isinstance(raw.data, bytes):
                    with suppress(UnreadableMessageError):
                        yield stamp_of(chosen, raw), deserialise(chosen, raw.data)
        except (OSError, sqlite3.Error) as error:
            raise RecordingError(f"the recording can no longer be read: {error}") from None
