# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Folders in the ASL format of the EuRoC MAV and TUM-VI datasets: CSV files and images."""

import heapq
import itertools
from collections.abc import Collection, Iterator
from operator import attrgetter
from pathlib import Path, PurePath

from ruledgraph.recording.container import Kind, RawMessage, Topic
from ruledgraph.recording.errors import RecordingError

IMAGE = "asl/Image"
IMU = "asl/Imu"
# A row is a stamp and a file's name or six numbers.
_LONGEST_ROW = 1000


def asl_root(folder: Path) -> Path | None:
    """The folder that holds `cam0` and `imu0`, the given one or its `mav0`; None if neither."""
    for root in (folder / "mav0", folder):
        if any(root.glob("cam*/data.csv")) or any(root.glob("imu*/data.csv")):
            return root
    return None


class AslFolder:
    """See `Container`; topics are the sensors' folders, `cam0`, `imu0`."""

    kind: Kind = "asl"

    def __init__(self, root: Path) -> None:
        self.root = root
        self.damage: dict[str, int] = {}
        tables = sorted([*root.glob("cam*/data.csv"), *root.glob("imu*/data.csv")])
        self.topics = []
        for table in tables:
            name = table.parent.name
            count = sum(1 for _ in self._rows(name))
            kind = IMAGE if name.startswith("cam") else IMU
            self.topics.append(Topic(name, kind, "asl", count))

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """See `Container`; a row's data are its other columns, of an image the file."""
        tables = [self._rows(topic.name) for topic in self.topics if topic.name in topics]
        return heapq.merge(*tables, key=attrgetter("received"))

    def _rows(self, name: str) -> Iterator[RawMessage]:
        table = self.root / name / "data.csv"
        where = f"{name}/{table.name}"
        if not table.is_file():
            raise RecordingError(f"{table} cannot be read: it is no file")
        try:
            with table.open("rb") as file:
                for number in itertools.count(1):
                    line = file.readline(_LONGEST_ROW)
                    if not line:
                        return
                    stamp, _, rest = line.strip().partition(b",")
                    if stamp.startswith(b"#") or not stamp:
                        continue
                    if not line.endswith(b"\n"):
                        # Its last number may lack digits.
                        self.damage[f"{where}: line {number} does not end"] = len(line)
                    elif not stamp.isdigit() or len(stamp) > 19:
                        self.damage[f"{where}: line {number} does not begin with a stamp"] = len(
                            line
                        )
                    elif name.startswith("cam"):
                        # Nothing outside of the sensor's folder is read, whatever is written.
                        image = PurePath(rest.strip().decode(errors="replace")).name
                        yield RawMessage(int(stamp), name, table.parent / "data" / image)
                    else:
                        yield RawMessage(int(stamp), name, rest)
        except OSError as error:
            raise RecordingError(f"{table} cannot be read: {error.strerror}") from None
