# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files (https://mcap.dev/spec), chunked or not, whole or cut."""

import struct
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from ruledgraph.recording.chunked import (
    Block,
    ChunkedFile,
    Connection,
    DamagedError,
    Record,
    string,
)
from ruledgraph.recording.container import MAX_BLOCK, Kind

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX = 1, 2, 3, 4, 5, 6, 7
_LAST_OP = 15
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")


class McapFile(ChunkedFile):
    """See `ChunkedFile`."""

    kind: Kind = "mcap"

    def _walk(self, file: BinaryIO, size: int) -> None:
        self._schemas: dict[int, str] = {}
        position = len(MAGIC)
        chunk: Block | None = None
        while position < size:
            op = None
            try:
                file.seek(position)
                op, length = _head(file.read(_HEAD.size))
                data = position + _HEAD.size
                end = data + length
                if op == _CHUNK:
                    chunk = _chunk(file, data, min(end, size))
                    self.blocks.append(chunk)
                elif end > size:
                    raise DamagedError
                elif op == _MESSAGE:
                    number, _, received, _ = _message_head(file.read(_MESSAGE_HEAD.size))
                    self._add_loose(position, end - position, received, number)
                elif op == _INDEX and chunk is not None:
                    self._note_index(chunk, file.read(min(length, MAX_BLOCK)))
                elif op in (_SCHEMA, _CHANNEL):
                    self._note(op, file.read(min(length, MAX_BLOCK)))
                elif op == _FOOTER:
                    return
            except DamagedError:
                self._cut(position, size, size - position)
                return
            position = end
        self._cut(size, size, max(position - size, 0))

    def _records(self, data: bytes) -> Iterator[Record]:
        position = 0
        while position < len(data):
            op, length = _head(data[position : position + _HEAD.size])
            begin = position + _HEAD.size
            position = begin + length
            if position > len(data):
                raise DamagedError(f"a record of {length} bytes reaches beyond it")
            if op == _MESSAGE:
                payload = begin + _MESSAGE_HEAD.size
                number, _, received, _ = _message_head(data[begin:payload])
                if number not in self.connections:
                    raise DamagedError(f"a message belongs to an unknown channel {number}")
                yield Record(received, number, data[payload:position])
            elif op in (_SCHEMA, _CHANNEL):
                self._note(op, data[begin:position])

    def _note(self, op: int, data: bytes) -> None:
        if len(data) < 4:
            raise DamagedError("a record ends too early")
        number, schema = struct.unpack_from("<HH", data)
        if op == _SCHEMA:
            self._schemas.setdefault(number, string(_sized(data, 2)))
        elif number not in self.connections:
            topic = _sized(data, 4)
            encoding = _sized(data, 8 + len(topic))
            type_name = self._schemas.get(schema, "")
            if type_name.count("/") == 1:  # as ROS 1 spells it
                type_name = type_name.replace("/", "/msg/")
            self.connections[number] = Connection(string(topic), type_name, string(encoding))

    @staticmethod
    def _note_index(chunk: Block, data: bytes) -> None:
        if len(data) < 6 or (len(data) - 6) % 16:
            raise DamagedError
        if len(data) > 6:
            times = np.frombuffer(data, "<u8", offset=6)[::2]
            chunk.counts[int.from_bytes(data[:2], "little")] += times.size
            chunk.start = min(chunk.start, int(times.min()))


def _head(data: bytes) -> tuple[int, int]:
    if len(data) < _HEAD.size:
        raise DamagedError("a record ends too early")
    op, length = _HEAD.unpack(data)
    # Numbers from 0x80 on are for private use.
    if op == 0 or _LAST_OP < op < 0x80:
        raise DamagedError(f"there is no record of type {op}")
    return op, length


def _message_head(data: bytes) -> tuple[int, int, int, int]:
    if len(data) < _MESSAGE_HEAD.size:
        raise DamagedError("a message ends too early")
    number, sequence, received, published = _MESSAGE_HEAD.unpack(data)
    return number, sequence, received, published


def _chunk(file: BinaryIO, begin: int, end: int) -> Block:
    fixed = file.read(_CHUNK_HEAD.size)
    if len(fixed) < _CHUNK_HEAD.size:
        raise DamagedError
    _, _, full_size, checksum, length = _CHUNK_HEAD.unpack(fixed)
    if length > 16:  # the names of compressions are short
        raise DamagedError
    compression = string(file.read(length))
    stored = file.read(8)
    if len(stored) < 8:
        raise DamagedError
    offset = begin + _CHUNK_HEAD.size + length + 8
    size = int.from_bytes(stored, "little")
    if offset + size > end:
        # Cut: its checksum cannot match, its messages up to the cut are good.
        size, checksum = end - offset, 0
    return Block(offset, size, compression, full_size, checksum)


def _sized(data: bytes, position: int) -> bytes:
    """The bytes after their length at a position."""
    length = int.from_bytes(data[position : position + 4], "little")
    value = data[position + 4 : position + 4 + length]
    if len(value) < length:
        raise DamagedError("a record ends too early")
    return value
