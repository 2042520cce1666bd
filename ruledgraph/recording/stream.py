# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One pass over a recording: from messages as they were received to measurements in order."""

import sqlite3
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.recording.container import Container, RawMessage, Topic, first_of
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.images import Grey, encoded_image
from ruledgraph.recording.inertial import (
    Accelerometer,
    Gyroscope,
    Part,
    interpolate_accelerometer,
    mark_gaps,
)
from ruledgraph.recording.messages import UnreadableMessageError, inertial_vectors, stamp_of
from ruledgraph.recording.order import Stamped, in_stamp_order
from ruledgraph.recording.report import Report
from ruledgraph.recording.topics import ImuTopics

# A stream that begins with so many unusable frames, or goes on with so many of another size than
# before, is not worth following further.
_MAX_BAD_FRAMES = 10
# rad/s and m/s^2; far beyond what any IMU measures, in whatever unit.
_ABSURD = 1e6

Decoder = Callable[[Topic, RawMessage], Grey]


class Source(NamedTuple):
    """What to read."""

    container: Container
    image_topic: Topic | None
    imu_topics: ImuTopics | None
    start: float
    """s after the first message."""
    duration: float | None
    """s."""
    keep_encoded: bool = False
    """Whether frames keep the PNG or JPEG they were recorded as."""


def read_stream(source: Source, decode: Decoder, report: Report) -> Iterator[Measurement]:
    """The stages of `Recording.stream`, the report filled on the way."""
    reader = _Pass(source, decode, report)
    try:
        ordered = in_stamp_order(reader.stamped(), reader.drop, reader.count_reordered)
        parts = reader.decoded(reader.cropped(ordered))
        yield from mark_gaps(interpolate_accelerometer(parts, report), report)
    except (OSError, sqlite3.Error) as error:
        raise RecordingError(f"the recording can no longer be read: {error}") from None
    reader.check_outcome()


class _Pass:
    def __init__(self, source: Source, decode: Decoder, report: Report) -> None:
        self._source = source
        self._decode = decode
        self._report = report
        self._size: tuple[int, ...] | None = None
        self._bad_frames = 0  # before the first good one
        self._odd_frames = 0  # of another size, one after the other
        self._ranges: dict[bool, tuple[int, int]] = {}  # of all stamps; True for the camera
        self._topics = {
            topic.name: topic for topic in (source.image_topic, *(source.imu_topics or ())) if topic
        }

    def stamped(self) -> Iterator[Stamped]:
        """Messages with their stamps, in the order of reception."""
        for message in self._source.container.messages(self._topics):
            topic = self._topics[message.topic]
            camera = topic is self._source.image_topic
            try:
                stamp = stamp_of(topic, message)
            except UnreadableMessageError as error:
                self.drop(Stamped(0, camera, topic, message), str(error))
                continue
            first, last = self._ranges.get(camera, (stamp, stamp))
            self._ranges[camera] = min(first, stamp), max(last, stamp)
            yield Stamped(stamp, camera, topic, message)

    def cropped(self, messages: Iterable[Stamped]) -> Iterator[Stamped]:
        """The messages between start and start + duration."""
        begin, end = 0, 2**63
        for message in messages:
            if not begin:
                begin = message.stamp + round(self._source.start * 1e9)
                if self._source.duration is not None:
                    end = begin + round(self._source.duration * 1e9)
            if message.stamp >= end:
                return
            if message.stamp >= begin:
                yield message

    def decoded(self, messages: Iterable[Stamped]) -> Iterator[Part]:
        """Images and vectors out of the messages; what cannot be used is counted."""
        for stamped in messages:
            part = self._decoded(stamped)
            if part is not None:
                yield part

    def _decoded(self, stamped: Stamped) -> Part | None:
        try:
            if not stamped.camera:
                return self._inertial(stamped)
            image = self._decode(stamped.topic, stamped.message)
            self._check_size(image)
            keep = self._source.keep_encoded
            encoded = encoded_image(stamped.topic, stamped.message) if keep else None
            return Frame(stamped.stamp, image, encoded)
        except UnreadableMessageError as error:
            self.drop(stamped, str(error))
            return None

    def drop(self, stamped: Stamped, why: str) -> None:
        """Count a message that is left out."""
        if not stamped.camera:
            self._report.skipped_imu[why] += 1
            return
        self._report.skipped_frames[why] += 1
        self._bad_frames += 1
        if self._size is None and self._bad_frames >= _MAX_BAD_FRAMES:
            raise RecordingError(
                f"the first {_MAX_BAD_FRAMES} frames of {stamped.topic.name} are unusable: {why}"
            )

    def count_reordered(self) -> None:
        """Count a message that is sorted in."""
        self._report.reordered += 1

    def check_outcome(self) -> None:
        """Complain of a pass that delivered nothing of a sensor it was asked for.

        Raises:
            RecordingError: saying why.
        """
        camera, imu = self._ranges.get(True), self._ranges.get(False)
        # With a duration reading stopped early: the other one may only have been about to begin.
        shortest = (self._source.duration or 0.0) * 1e9
        if camera and imu and max(imu[0] - camera[1], camera[0] - imu[1]) > shortest:
            raise RecordingError(
                f"the stamps do not overlap: camera {_seconds(camera)}, IMU {_seconds(imu)}"
            )
        report = self._report
        for wanted, delivered, skipped, own, what in (
            (self._source.image_topic, report.frames, report.skipped_frames, camera, "frame"),
            (self._source.imu_topics, report.imu, report.skipped_imu, imu, "IMU sample"),
        ):
            if wanted is None or delivered.count:
                continue
            if skipped:
                why, n = skipped.most_common(1)[0]
                raise RecordingError(f"no {what} could be used; {n} were skipped: {why}")
            if own is not None:
                begin = min(stamp for pair in self._ranges.values() for stamp in pair)
                first, last = ((stamp - begin) * 1e-9 for stamp in own)
                there = f"{first:.2f} to {last:.2f} s" if last > first else f"{first:.2f} s alone"
                raise RecordingError(f"no {what} in the stretch of time; there are some at {there}")
            raise RecordingError(f"no {what} could be read{first_of(report.damage)}")

    def _check_size(self, image: Grey) -> None:
        if self._size is None:
            self._size = image.shape
        if image.shape == self._size:
            self._odd_frames = 0
            return
        self._odd_frames += 1
        height, width = self._size
        why = f"it is {image.shape[1]}x{image.shape[0]}, not {width}x{height} like those before"
        if self._odd_frames >= _MAX_BAD_FRAMES:
            raise RecordingError(f"the frames change their size: one after the other, {why}")
        raise UnreadableMessageError(why)

    def _inertial(self, stamped: Stamped) -> Part:
        _, _, topic, message = stamped
        if not isinstance(message.data, bytes) or self._source.imu_topics is None:
            raise UnreadableMessageError("it is no IMU message")
        gyroscope, accelerometer = inertial_vectors(topic, message.data)
        part: Part
        if not self._source.imu_topics.split:
            part = ImuSample(stamped.stamp, gyroscope, accelerometer)
        elif topic is self._source.imu_topics.gyroscope:
            part = Gyroscope(stamped.stamp, gyroscope)
        else:
            part = Accelerometer(stamped.stamp, accelerometer)
        if not (np.abs(part[1:]) < _ABSURD).all():  # nor when NaN
            raise UnreadableMessageError("its numbers are not finite, or absurd")
        return part


def _seconds(stamps: tuple[int, int]) -> str:
    return f"{stamps[0] * 1e-9:.3f} to {stamps[1] * 1e-9:.3f} s"
