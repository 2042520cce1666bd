# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""ROS 1 bags, format 2.0 (http://wiki.ros.org/Bags/Format/2.0), indexed or not, whole or cut."""

import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

import numpy as np

from ruledgraph.recording.chunked import (
    Block,
    ChunkedFile,
    Connection,
    DamagedError,
    Record,
    string,
)
from ruledgraph.recording.container import Kind
from ruledgraph.recording.errors import RecordingError

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
# Bytes; headers hold a few numbers or a topic's name.
_LONGEST_HEADER = 2**16


class _Head(NamedTuple):
    op: int
    fields: dict[bytes, bytes]
    start: int
    """Of the record."""
    data: int
    """Where its data begin."""
    end: int


class Rosbag1(ChunkedFile):
    """See `ChunkedFile`."""

    kind: Kind = "rosbag1"

    def _walk(self, file: BinaryIO, size: int) -> None:
        position, promised = len(MAGIC), size
        chunk: Block | None = None
        while position < size:
            try:
                head = _read_head(file, position)
                if head.op == _BAG:
                    if head.fields.get(b"encryptor"):
                        raise RecordingError(f"{self.path} is encrypted, which is not supported")
                    # Where the index was written, when the bag was closed in order.
                    promised = max(promised, _number(head.fields, b"index_pos", "<Q"))
                elif head.op == _CHUNK:
                    chunk = Block(
                        head.data,
                        min(head.end, size) - head.data,
                        string(_field(head.fields, b"compression")),
                        _number(head.fields, b"size", "<I"),
                    )
                    self.blocks.append(chunk)
                elif head.end > size:
                    raise DamagedError
                elif head.op == _INDEX and chunk is not None:
                    self._note_index(chunk, head, file.read(head.end - head.data))
                elif head.op == _CHUNK_INFO:
                    promised = size  # this is the index: nothing is missing before it
                elif head.op == _CONNECTION:
                    self._note_connection(head, file.read(head.end - head.data))
                elif head.op == _MESSAGE:
                    # In a bag whose recording was killed the last chunk has no size yet: its
                    # records follow it like loose ones.
                    number = _number(head.fields, b"conn", "<I")
                    self._add_loose(position, head.end - position, _time(head.fields), number)
            except DamagedError:
                self._cut(position, size, max(promised, size) - position)
                return
            position = head.end
        if position > size or promised > size:
            self._cut(size, max(promised, size), max(position, promised) - size)

    def _records(self, data: bytes) -> Iterator[Record]:
        position = 0
        while position < len(data):
            head = _parse_head(data, position)
            if head.end > len(data):
                raise DamagedError(f"a record of {head.end - head.start} bytes reaches beyond it")
            if head.op == _MESSAGE:
                number = _number(head.fields, b"conn", "<I")
                if number not in self.connections:
                    raise DamagedError(f"a message belongs to an unknown connection {number}")
                yield Record(_time(head.fields), number, data[head.data : head.end])
            elif head.op == _CONNECTION:
                self._note_connection(head, data[head.data : head.end])
            else:
                raise DamagedError(f"a record of type {head.op} has no place in it")
            position = head.end

    @staticmethod
    def _note_index(chunk: Block, head: _Head, data: bytes) -> None:
        if len(data) % 12:
            raise DamagedError
        # Seconds, nanoseconds, and where in the chunk.
        entries = np.frombuffer(data, "<u4").reshape(-1, 3).astype(np.int64)
        if len(entries):
            times = entries[:, 0] * 10**9 + entries[:, 1]
            chunk.start = min(chunk.start, int(times.min()))
            chunk.counts[_number(head.fields, b"conn", "<I")] += len(times)

    def _note_connection(self, head: _Head, data: bytes) -> None:
        number = _number(head.fields, b"conn", "<I")
        if number in self.connections:
            return
        package, _, name = string(_field(_parse_fields(data), b"type")).partition("/")
        topic = string(_field(head.fields, b"topic"))
        self.connections[number] = Connection(topic, f"{package}/msg/{name}", "ros1")


def _read_head(file: BinaryIO, position: int) -> _Head:
    file.seek(position)
    (length,) = _unpack("<I", file.read(4))
    if length > _LONGEST_HEADER:
        raise DamagedError
    file.seek(position)
    head = _parse_head(file.read(length + 8), 0)
    file.seek(position + head.data)
    return head._replace(start=position, data=position + head.data, end=position + head.end)


def _parse_head(data: bytes, position: int) -> _Head:
    (length,) = _unpack("<I", data[position : position + 4])
    begin = position + 4 + length
    fields = _parse_fields(data[position + 4 : begin])
    (size,) = _unpack("<I", data[begin : begin + 4])
    return _Head(_number(fields, b"op", "<B"), fields, position, begin + 4, begin + 4 + size)


def _parse_fields(header: bytes) -> dict[bytes, bytes]:
    fields = {}
    position = 0
    while position < len(header):
        (length,) = _unpack("<I", header[position : position + 4])
        position += 4
        name, equals, value = header[position : position + length].partition(b"=")
        if not equals or position + length > len(header):
            raise DamagedError("a header makes no sense")
        fields[name] = value
        position += length
    return fields


def _field(fields: dict[bytes, bytes], name: bytes) -> bytes:
    try:
        return fields[name]
    except KeyError:
        raise DamagedError(f"a header lacks {name.decode()!r}") from None


def _number(fields: dict[bytes, bytes], name: bytes, form: str) -> int:
    (number,) = _unpack(form, _field(fields, name))
    return number


def _time(fields: dict[bytes, bytes]) -> int:
    seconds, nanoseconds = _unpack("<II", _field(fields, b"time"))
    return seconds * 10**9 + nanoseconds


def _unpack(form: str, data: bytes) -> tuple[int, ...]:
    try:
        return struct.unpack(form, data)
    except struct.error:
        raise DamagedError("a record ends too early") from None
