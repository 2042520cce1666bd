# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""ROS 2 bags: a folder of sqlite3 or MCAP files, compressed or not."""

import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterator
from pathlib import Path, PurePath

from backports import zstd
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

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


class Rosbag2:
    """Files of one recording, one after the other; see `Container`.

    Which files, and in what order, is read from them, so a folder whose recording was killed
    before `metadata.yaml` was written is read too. Files that are compressed as a whole are
    decompressed into a temporary folder.
    """

    kind: Kind = "rosbag2"

    def __init__(self, folder: Path) -> None:
        self.damage: dict[str, int] = {}
        files = storage_files(folder)
        for name in sorted(_listed(folder, self.damage) - {file.name for file in files}):
            self.damage[f"{METADATA} lists {name}, which is missing"] = 0
        if not files:
            raise RecordingError(f"{folder} holds no sqlite3 or MCAP file of a ROS 2 bag")
        parts = [part for file in files if (part := self._open(file))]
        if not parts:
            raise RecordingError(next(iter(self.damage)))
        self._parts = sorted(parts, key=_first_reception)
        self.topics = merge_topics([topic for part in parts for topic in part.topics])
        self._collect_damage()

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """See `Container`."""
        for part in self._parts:
            yield from map(_decompressed, part.messages(topics))
            self._collect_damage()

    def _open(self, file: Path) -> Container | None:
        try:
            return open_storage(file, self)
        except RecordingError as error:
            self.damage[str(error)] = file.stat().st_size
            return None

    def _collect_damage(self) -> None:
        for part in self._parts:
            self.damage.update(part.damage)


def storage_files(folder: Path) -> list[Path]:
    """The files of a folder that hold messages, by what they begin with, sorted by name."""
    magics = (MCAP_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC)
    return [file for file in sorted(folder.iterdir()) if _magic(file).startswith(magics)]


def open_storage(file: Path, owner: object) -> Container:
    """Open one file; what is decompressed for it lives as long as its owner."""
    damage = {}
    name = file.name
    if _magic(file).startswith(ZSTD_MAGIC):
        folder = tempfile.mkdtemp(prefix="ruledgraph-")
        weakref.finalize(owner, shutil.rmtree, folder, ignore_errors=True)
        target = Path(folder, "decompressed")
        try:
            with zstd.open(file) as source, target.open("wb") as sink:
                shutil.copyfileobj(source, sink)
        except (zstd.ZstdError, EOFError) as error:
            damage[f"{name} is damaged: {error}; what follows is lost"] = file.stat().st_size
        file = target
    magic = _magic(file)
    if not magic.startswith((MCAP_MAGIC, SQLITE_MAGIC)):
        raise RecordingError(f"{name} holds neither an MCAP file nor an sqlite3 database")
    part: Container = McapFile(file) if magic.startswith(MCAP_MAGIC) else SqliteFile(file)
    part.damage.update(damage)
    return part


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


def _listed(folder: Path, damage: dict[str, int]) -> set[str]:
    """Names of the files that `metadata.yaml` lists."""
    path = folder / METADATA
    if not path.exists():
        damage[f"{METADATA} is missing: the recording was not closed in order"] = 0
        return set()
    try:
        content = YAML(typ="safe").load(path.read_bytes())
        listed = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return {PurePath(name).name for name in listed}
    except (YAMLError, UnicodeDecodeError, LookupError, TypeError, ValueError) as error:
        damage[f"{METADATA} cannot be read: {type(error).__name__}"] = 0
        return set()
