# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The sqlite3 databases of ROS 2 bags."""

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from ruledgraph.recording.container import Kind, RawMessage, Topic, merge_topics
from ruledgraph.recording.errors import RecordingError

MAGIC = b"SQLite format 3\0"


class SqliteFile:
    """One database; see `Container`."""

    kind: Kind = "rosbag2"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: dict[str, int] = {}
        self._truncated = _missing_bytes(path)
        if self._truncated:
            self.damage[f"{path.name} was cut: what follows is lost"] = self._truncated
        try:
            with closing(self._connect()) as database:
                rows = database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                ).fetchall()
                topics = {
                    number: Topic(str(name), str(type_), str(encoding), 0)
                    for number, name, type_, encoding in rows
                    if isinstance(number, int)
                }
                counts = dict.fromkeys(topics, 0)
                try:
                    for number, count in database.execute(
                        "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
                    ):
                        counts[number] = count
                except sqlite3.DatabaseError:
                    for number, *_ in self._rows(database, topics):
                        counts[number] += 1
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise RecordingError(f"{path} cannot be read as a ROS 2 bag: {error}") from None
        self._topics = topics
        self.topics = merge_topics(
            [t._replace(message_count=counts.get(i, 0)) for i, t in topics.items()]
        )

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """See `Container`; by the order of reception, in a damaged file by that of writing."""
        wanted = [i for i, topic in self._topics.items() if topic.name in topics]
        with closing(self._connect()) as database:
            for number, received, data in self._rows(database, wanted):
                yield RawMessage(received, self._topics[number].name, data)

    def _rows(
        self, database: sqlite3.Connection, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        # A table is written from its first page on, so of a file that was cut the rows can be
        # read up to the cut; the index by time may lie anywhere.
        order = "id" if self._truncated else "timestamp"
        delivered = 0
        numbers = ",".join(str(int(number)) for number in wanted)
        try:
            for number, received, data in database.execute(
                "SELECT topic_id, timestamp, data FROM messages "  # noqa: S608 - integers only
                f"WHERE topic_id IN ({numbers}) ORDER BY {order}"
            ):
                if isinstance(received, int) and isinstance(data, bytes):
                    yield number, received, data
                    delivered += len(data)
        except sqlite3.DatabaseError as error:
            lost = max(0, self.path.stat().st_size - delivered)
            self.damage[f"{self.path.name} is damaged: {error}; what follows is lost"] = lost

    def _connect(self) -> sqlite3.Connection:
        # Immutable: no lock, no journal, also in a folder that cannot be written. What a killed
        # recording left in its write-ahead log is only seen without it.
        log = self.path.with_name(self.path.name + "-wal")
        mode = "mode=ro" if log.exists() else "immutable=1"
        return sqlite3.connect(f"file:{quote(str(self.path))}?{mode}", uri=True)


def _missing_bytes(path: Path) -> int:
    """By how much a database is shorter than its header says."""
    with path.open("rb") as file:
        header = file.read(32)
    if len(header) < 32:
        raise RecordingError(f"{path} ends after {len(header)} bytes, in its header")
    page = int.from_bytes(header[16:18], "big")
    pages = int.from_bytes(header[28:32], "big")
    return max(0, (65536 if page == 1 else page) * pages - path.stat().st_size)
