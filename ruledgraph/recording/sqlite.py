# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The sqlite3 databases of ROS 2 bags."""

import sqlite3
from collections import deque
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from ruledgraph.recording.container import Kind, RawMessage, Topic, merge_topics, printable
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
                    number: Topic(_text(name), _text(type_), _text(encoding), 0)
                    for number, name, type_, encoding in rows
                    if isinstance(number, int)
                }
                counts = self._counts(database, topics)
        except sqlite3.Error as error:
            raise RecordingError(f"{path.name} is no readable ROS 2 bag: {error}") from None
        self._topics = topics
        self.topics = merge_topics(
            [t._replace(message_count=counts.get(i, 0)) for i, t in topics.items()]
        )

    def _counts(self, database: sqlite3.Connection, topics: Collection[int]) -> dict[int, int]:
        """Messages of each topic; those of none are damage."""
        counts, others = dict.fromkeys(topics, 0), 0
        try:
            for number, count in database.execute(
                "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
            ):
                if number in counts:
                    counts[number] = count
                else:
                    others += count
        except sqlite3.DatabaseError:
            for number, *_ in self._rows(database, topics):
                counts[number] += 1
        self._note_rows(others, "belong to no topic")
        return counts

    def _note_rows(self, count: int, why: str) -> None:
        if count:
            rows = "row" if count == 1 else "rows"
            self.damage[f"{self.path.name}: {count} {rows} of messages {why}"] = 0

    def _check_tables(self, database: sqlite3.Connection) -> None:
        """Views and computed columns are programs: they may run without end."""
        for name in ("topics", "messages"):
            found = database.execute(
                "SELECT type, sql FROM sqlite_master WHERE name = ?", (name,)
            ).fetchone()
            kind, statement = map(_text, found or ("", ""))
            words = statement.upper()
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
        delivered = odd = 0
        numbers = ",".join(str(int(number)) for number in wanted)
        try:
            for number, received, data in database.execute(
                "SELECT topic_id, timestamp, data FROM messages "  # noqa: S608 - integers only
                f"WHERE topic_id IN ({numbers}) ORDER BY {order}"
            ):
                if isinstance(received, int | float) and isinstance(data, bytes):
                    yield number, int(received), data
                    delivered += len(data)
                else:
                    odd += 1
            self._note_rows(odd, "hold no time or no bytes: they are left out")
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
        # The collector of garbage may close it in another thread than the one that reads.
        database = sqlite3.connect(
            f"file:{quote(str(self.path))}?{mode}", uri=True, check_same_thread=False
        )
        database.text_factory = bytes  # a message may be stored as text
        if self._truncated:
            # Otherwise sqlite refuses a file that is shorter than its header says.
            database.execute("PRAGMA writable_schema = ON")
        return database


def _text(value: object) -> str:
    """A name as it can be shown and asked for."""
    return printable(value.decode(errors="replace") if isinstance(value, bytes) else str(value))


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
