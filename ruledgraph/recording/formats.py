# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Which kind of recording it is, told from what it holds."""

import re
from collections.abc import Iterator
from pathlib import Path

from ruledgraph.recording.asl import AslFolder, asl_root
from ruledgraph.recording.container import Container
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.mcap import MAGIC as MCAP_MAGIC
from ruledgraph.recording.rosbag1 import MAGIC as ROSBAG1_MAGIC
from ruledgraph.recording.rosbag1 import Rosbag1
from ruledgraph.recording.rosbag2 import METADATA, ZSTD_MAGIC, Rosbag2, storage_files
from ruledgraph.recording.sqlite import MAGIC as SQLITE_MAGIC


def open_container(path: Path) -> Container:
    """Open a recording of any kind.

    Raises:
        RecordingError: when it is none, or damaged beyond use.
    """
    try:
        return _open(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from None


def _why_none(folder: Path) -> str:
    if found := sorted(folder.glob("*.bag")):
        several = "a recording" if len(found) == 1 else f"{len(found)} recordings"
        return f"{folder} holds {several}; name one, such as {found[0]}"
    return (
        f"{folder} holds no recording: no *.bag, *.mcap or *.db3, and no mav0/cam0/data.csv as of "
        "EuRoC"
    )


def _open(path: Path) -> Container:
    if not path.exists():
        raise RecordingError(f"{path} does not exist")
    if path.is_dir():
        root = asl_root(path)
        if root is not None:
            return AslFolder(root)
        if (path / METADATA).exists() or storage_files(path):
            return Rosbag2(path)
        raise RecordingError(_why_none(path))
    if not path.is_file():
        raise RecordingError(f"{path} is no recording: it is a device or a pipe, not a file")
    with path.open("rb") as file:
        magic = file.read(16)
    if not magic:
        raise RecordingError(f"{path} is empty")
    if magic.startswith(ROSBAG1_MAGIC):
        return Rosbag1(path)
    if magic.startswith(b"#ROSBAG V"):
        version = magic[9:12].decode(errors="replace")
        raise RecordingError(f"{path} is a ROS 1 bag of format {version}; convert it to 2.0")
    if magic.startswith((MCAP_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC)):
        return Rosbag2(path)
    raise RecordingError(
        f"{path} is no recording: it begins like neither a ROS 1 bag, an MCAP file nor a ROS 2 "
        "database"
    )


# The files of one ROS 2 bag are numbered: flight_0.mcap, flight_1.mcap.
_PART = re.compile(r"(.+)_\d+\.(?:mcap|db3)(?:\.zstd)?")


def recordings_in(folder: Path) -> list[Path]:
    """The recordings in a folder and its subfolders, in order of their names; the folder itself
    where it is one.
    """
    return sorted(_found(folder))


def _found(folder: Path) -> Iterator[Path]:
    if _is_bag(folder) or asl_root(folder) is not None:
        yield folder
        return
    for path in folder.iterdir():
        if path.name.startswith("."):
            continue
        if path.is_dir():
            if not folder.resolve().is_relative_to(path.resolve()):  # a link back would not end
                yield from _found(path)
        elif path.is_file():
            with path.open("rb") as file:
                if file.read(16).startswith((ROSBAG1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC)):
                    yield path


def _is_bag(folder: Path) -> bool:
    """Whether a folder is one ROS 2 bag, not a place for several files."""
    if (folder / METADATA).exists():
        return True
    parts = [_PART.fullmatch(file.name) for file in storage_files(folder)]
    return bool(parts) and None not in parts and len({part[1] for part in parts if part}) == 1
