# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What ROS 1 bags and MCAP files have in common: records, most of them in compressed chunks.

The index at the end of such a file is not used: the records are walked from the start, from chunk
to chunk. It costs a seek a chunk, and a recording that was cut is read like any other, up to the
cut.
"""

import bz2
import heapq
import itertools
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
from backports import zstd

from ruledgraph.recording.container import (
    MAX_BLOCK,
    Kind,
    RawMessage,
    Topic,
    merge_topics,
    printable,
)

# Bytes; records outside of chunks are gathered to blocks of about this size.
_LOOSE_BLOCK = 2**20
# Bytes decompressed at a time.
_PIECE = 2**22
_UNCOMPRESSED = ("", "none")


class DamagedError(Exception):
    """The bytes are not what the format promises."""


class Connection(NamedTuple):
    """What a record says of the messages that carry its number."""

    topic: str
    type: str
    encoding: str


class Record(NamedTuple):
    """A message inside a block."""

    received: int
    connection: int
    data: bytes


@dataclass
class Block:
    """Consecutive records: a chunk, or messages that are in none."""

    offset: int
    """Where the bytes begin in the file."""
    size: int
    compression: str = ""
    full_size: int = 0
    """Bytes, decompressed; only of use with a compression."""
    checksum: int = 0
    """CRC-32 of the decompressed bytes; 0 for none."""
    start: int = 2**63 - 1
    """When its earliest message was received, ns."""
    counts: Counter[int] = field(default_factory=Counter)
    """Messages of each connection."""


class ChunkedFile(ABC):
    """A file of records. Subclasses know the format."""

    kind: Kind

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: dict[str, int] = {}
        self.blocks: list[Block] = []
        self.connections: dict[int, Connection] = {}
        size = path.stat().st_size
        with path.open("rb") as file:
            self._walk(file, size)
            for block in self.blocks:
                # A chunk whose index is missing, or which holds the definition of its topics.
                if not block.counts or not block.counts.keys() <= self.connections.keys():
                    self._examine(file, block)
        counts: Counter[int] = Counter()
        for block in self.blocks:
            counts.update(block.counts)
        self.topics = merge_topics([Topic(*c, counts[i]) for i, c in self.connections.items()])

    @abstractmethod
    def _walk(self, file: BinaryIO, size: int) -> None:
        """Find the blocks, and the connections outside of them."""

    @abstractmethod
    def _records(self, data: bytes) -> Iterator[Record]:
        """The messages in a block's bytes; notes the connections it meets.

        Raises:
            DamagedError: where the bytes make no sense; what comes after is lost.
        """

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """The messages of these topics in the order of their reception; see `Container`.

        Blocks that overlap in time are merged, so a topic that was written after another, as
        some converters do, comes out beside it.
        """
        wanted = {i for i, c in self.connections.items() if c.topic in topics}
        order = itertools.count()
        queue: list[tuple[int, int, RawMessage]] = []
        with self.path.open("rb") as file:
            for block in sorted(self.blocks, key=lambda block: block.start):
                if wanted.isdisjoint(block.counts):
                    continue
                while queue and queue[0][0] < block.start:
                    yield heapq.heappop(queue)[2]
                for received, number, data in self._read(file, block):
                    if number in wanted:
                        message = RawMessage(received, self.connections[number].topic, data)
                        heapq.heappush(queue, (received, next(order), message))
        while queue:
            yield heapq.heappop(queue)[2]

    def _examine(self, file: BinaryIO, block: Block) -> None:
        counts: Counter[int] = Counter()
        for record in self._read(file, block):
            counts[record.connection] += 1
            block.start = min(block.start, record.received)
        block.counts = counts

    def _read(self, file: BinaryIO, block: Block) -> Iterator[Record]:
        file.seek(block.offset)
        delivered = 0
        try:
            data = decompress(file.read(block.size), block.compression, block.full_size)
            if block.checksum and zlib.crc32(data) != block.checksum:
                raise DamagedError("its checksum does not match")
            for record in self._records(data):
                delivered += len(record.data)
                yield record
            if block.compression not in _UNCOMPRESSED and len(data) < block.full_size:
                raise DamagedError("it ends too early")
        except DamagedError as error:
            lost = max(block.size, block.full_size) - delivered
            self.damage[f"the chunk at byte {block.offset} is damaged: {error}"] = lost

    def _add_loose(self, offset: int, size: int, received: int, connection: int) -> None:
        """Note a message outside of chunks."""
        last = self.blocks[-1] if self.blocks else None
        if (
            last is None
            or last.compression
            or last.checksum
            or last.size > _LOOSE_BLOCK
            or (last.offset + last.size != offset)
        ):
            last = Block(offset, 0)
            self.blocks.append(last)
        last.size += size
        last.start = min(last.start, received)
        last.counts[connection] += 1

    def _cut(self, position: int, size: int, missing: int) -> None:
        self.damage[
            f"{self.path.name} was cut or is damaged at byte {position} of {size}: "
            "what follows is lost"
        ] = missing


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """At most `size` bytes, whatever the data claim.

    Raises:
        DamagedError: for data that cannot be decompressed.
    """
    if compression in _UNCOMPRESSED:
        return data
    if size > MAX_BLOCK:
        raise DamagedError(f"a size of {size} bytes is not plausible")
    try:
        if compression == "bz2":
            return bz2.BZ2Decompressor().decompress(data, size)
        if compression == "lz4":
            return _lz4(data, size)
        if compression == "zstd":
            return zstd.ZstdDecompressor().decompress(data, size)
    except (OSError, ValueError, RuntimeError, EOFError, zstd.ZstdError) as error:
        raise DamagedError(f"{compression} cannot decompress it: {error}") from None
    raise DamagedError(f"unknown compression {compression!r}")


def _lz4(data: bytes, size: int) -> bytes:
    """Piece by piece: for the longest result asked for, lz4 would allocate all of it at once."""
    decompressor = lz4.frame.LZ4FrameDecompressor()
    pieces, found = [], 0
    while found < size and not decompressor.eof:
        piece = decompressor.decompress(data, min(_PIECE, size - found))
        if not piece:
            break  # cut
        pieces.append(piece)
        found += len(piece)
        data = b""
    return b"".join(pieces)


def string(data: bytes) -> str:
    """The text of a record, control characters escaped."""
    return printable(data.decode(errors="replace"))
