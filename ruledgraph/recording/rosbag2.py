# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""ROS 2 bags: a folder of sqlite3 or MCAP files, compressed or not."""

import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterator
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from backports import zstd

from ruledgraph.core.plain_yaml import YamlError, read_yaml
from ruledgraph.recording.chunked import DamagedError, decompress
from ruledgraph.recording.container import (
    MAX_BLOCK,
    Container,
    Kind,
    RawMessage,
    merge_topics,
)
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.mcap import MAGIC as MCAP_MAGIC
from ruledgraph.recording.mcap import McapFile
from ruledgraph.recording.sqlite import MAGIC as SQLITE_MAGIC
from ruledgraph.recording.sqlite import SqliteFile

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
METADATA = "metadata.yaml"
_LONGEST_MAGIC = 16
# Bytes decompressed at a time.
_PIECE = 2**20
# A compressed file that unpacks to more than so many times its size, and a few hundred MB, is none
# of sensor data: it would fill the disk.
_MAX_GROWTH, _MAX_GROWTH_OF_SMALL = 100, 2**28
# Bytes; it has some hundreds for a topic.
_LARGEST_METADATA = 2_000_000


class Rosbag2:
    """The folder of a ROS 2 bag, or a single file of one; see `Container`.

    Which files there are, and in what order, is read from them, so a folder whose recording was
    killed before `metadata.yaml` was written is read too. A file that is compressed as a whole is
    decompressed into a temporary folder, which lives as long as the object.
    """

    def __init__(self, path: Path) -> None:
        self.damage: dict[str, int] = {}
        self._folder: Path | None = None
        files = storage_files(path) if path.is_dir() else [path]
        if path.is_dir():
            self._check_metadata(path / METADATA, {file.name for file in files})
        parts = [part for file in files if (part := self._open(file))]
        if not parts:
            causes = "; ".join(self.damage) or "it holds no sqlite3 or MCAP file"
            raise RecordingError(f"{path} cannot be read: {causes}")
        self.kind: Kind = "rosbag2" if path.is_dir() else parts[0].kind
        self.topics = merge_topics([topic for part in parts for topic in part.topics])
        self._parts = sorted(parts, key=_first_reception)
        self._collect_damage()

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """See `Container`."""
        for part in self._parts:
            yield from map(_decompressed, part.messages(topics))
            self._collect_damage()

    def _open(self, file: Path) -> Container | None:
        size = file.stat().st_size
        magic = _magic(file)
        if magic.startswith(ZSTD_MAGIC):
            file = self._decompress(file)
            magic = _magic(file)
        try:
            if magic.startswith(MCAP_MAGIC):
                return McapFile(file)
            if magic.startswith(SQLITE_MAGIC):
                return SqliteFile(file)
        except RecordingError as error:
            self.damage[str(error)] = size
        else:
            self.damage[f"{file.name} holds neither an MCAP file nor an sqlite3 database"] = size
        return None

    def _decompress(self, file: Path) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="ruledgraph-"))
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        target = self._folder / file.name
        decompressor = zstd.ZstdDecompressor()
        try:
            with file.open("rb") as source, target.open("wb") as sink:
                most = max(_MAX_GROWTH * file.stat().st_size, _MAX_GROWTH_OF_SMALL)
                for piece in _unpacked(source, decompressor):
                    sink.write(piece)
                    if sink.tell() > most:
                        raise EOFError(f"it unpacks to more than {most // 2**20} MB")
            damage = "" if decompressor.eof else "it ends too early"
        except (zstd.ZstdError, EOFError) as error:
            damage = str(error)
        if damage:
            self.damage[f"{file.name} was cut or is damaged: {damage}; what follows is lost"] = 0
        return target

    def _check_metadata(self, path: Path, found: set[str]) -> None:
        if not path.is_file():
            self.damage[f"{METADATA} is missing: the recording was not closed in order"] = 0
            return
        try:
            content: Any = read_yaml(path, _LARGEST_METADATA)
            listed = content["rosbag2_bagfile_information"]["relative_file_paths"]
            missing = {PurePath(name).name for name in listed} - found
        except (YamlError, LookupError, TypeError) as error:
            self.damage[f"{METADATA} cannot be read ({type(error).__name__})"] = 0
            return
        for name in sorted(missing):
            self.damage[f"{METADATA} lists {name}, which is missing"] = 0

    def _collect_damage(self) -> None:
        for part in self._parts:
            self.damage.update(part.damage)


def _unpacked(source: BinaryIO, decompressor: zstd.ZstdDecompressor) -> Iterator[bytes]:
    """What a file decompresses to, piece by piece."""
    while data := source.read(_PIECE):
        yield decompressor.decompress(data, _PIECE)
        while not (decompressor.needs_input or decompressor.eof):
            yield decompressor.decompress(b"", _PIECE)


def storage_files(folder: Path) -> list[Path]:
    """The files of a folder that hold messages, by what they begin with, sorted by name."""
    magics = (MCAP_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC)
    return [file for file in sorted(folder.iterdir()) if _magic(file).startswith(magics)]


def _first_reception(part: Container) -> int:
    messages = part.messages([topic.name for topic in part.topics])
    return next((message.received for message in messages), 0)


def _magic(file: Path) -> bytes:
    if not file.is_file():
        return b""
    with file.open("rb") as stream:
        return stream.read(_LONGEST_MAGIC)


def _decompressed(message: RawMessage) -> RawMessage:
    """A message out of a bag compressed message by message. None begins like zstd's frames."""
    data = message.data
    if isinstance(data, bytes) and data.startswith(ZSTD_MAGIC):
        try:
            return message._replace(data=decompress(data, "zstd", MAX_BLOCK))
        except DamagedError:
            return message  # it will not decode, and be counted
    return message
