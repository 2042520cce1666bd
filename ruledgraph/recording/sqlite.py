# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The sqlite3 databases of ROS 2 bags."""

import sqlite3
from collections import deque
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
        self._page, self._truncated = _read_header(path)
        if self._truncated:
            self.damage[f"{path.name} was cut: what follows is lost"] = self._truncated
        try:
            with closing(self._connect()) as database:
                self._check_tables(database)
                rows = database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                ).fetchall()
                topics = {
                    number: Topic(str(name), str(type_), str(encoding), 0)
                    for number, name, type_, encoding in rows
                    if isinstance(number, int) and str(name).isprintable()
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
            raise RecordingError(f"{path.name} is no readable ROS 2 bag: {error}") from None
        self._topics = topics
        self.topics = merge_topics(
            [t._replace(message_count=counts.get(i, 0)) for i, t in topics.items()]
        )

    def _check_tables(self, database: sqlite3.Connection) -> None:
        """Views and computed columns are programs: they may run without end."""
        for name in ("topics", "messages"):
            found = database.execute(
                "SELECT type, sql FROM sqlite_master WHERE name = ?", (name,)
            ).fetchone()
            kind, statement = found or ("", "")
            words = str(statement).upper()
            if kind != "table" or " VIRTUAL " in words or " AS " in words.replace("(", " "):
                raise RecordingError(f"{self.path.name} is no ROS 2 bag: {name} is no table of one")

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """See `Container`; by the order of reception, in a damaged file by that of writing."""
        wanted = [i for i, topic in self._topics.items() if topic.name in topics]
        with closing(self._connect()) as database:
            rows = self._rows(database, wanted)
            for number, received, data in self._whole(rows) if self._truncated else rows:
                yield RawMessage(received, self._topics[number].name, data)

    def _whole(self, rows: Iterator[tuple[int, int, bytes]]) -> Iterator[tuple[int, int, bytes]]:
        """All but the last rows, those that may lie in the page that was cut.

        Sqlite takes the missing part of that page for zeros. It may belong to any of the rows
        that are followed by less than a page of others.
        """
        waiting: deque[tuple[int, int, bytes]] = deque()
        size = 0
        for row in rows:
            waiting.append(row)
            size += len(row[2])
            while size - len(waiting[0][2]) >= self._page:
                size -= len(waiting[0][2])
                yield waiting.popleft()

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
            if self._truncated:
                return  # that is the cut
            lost = max(0, self.path.stat().st_size - delivered)
            self.damage[f"{self.path.name} is damaged: {_line(error)}; what follows is lost"] = lost

    def _connect(self) -> sqlite3.Connection:
        # Immutable: no lock, no journal, also in a folder that cannot be written. What a killed
        # recording left in its write-ahead log is only seen without it.
        log = self.path.with_name(self.path.name + "-wal")
        mode = "mode=ro" if log.exists() else "immutable=1"
        database = sqlite3.connect(f"file:{quote(str(self.path))}?{mode}", uri=True)
        if self._truncated:
            # Otherwise sqlite refuses a file that is shorter than its header says.
            database.execute("PRAGMA writable_schema = ON")
        return database


def _line(error: Exception) -> str:
    """In one line; sqlite quotes statements."""
    return " ".join(str(error).split())


def _read_header(path: Path) -> tuple[int, int]:
    """Bytes of a page, and by how many bytes the database is shorter than it should be."""
    with path.open("rb") as file:
        header = file.read(32)
    if len(header) < 32:
        raise RecordingError(f"{path.name} ends after {len(header)} bytes, in its header")
    page = int.from_bytes(header[16:18], "big")
    page = 65536 if page == 1 else page
    pages = int.from_bytes(header[28:32], "big")
    return page, max(0, page * pages - path.stat().st_size)
