# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Folders for what is written, in which nothing is ever overwritten."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ruledgraph.core.errors import RuledgraphError, machine_error


class FolderError(RuledgraphError):
    """A folder that holds something already, or that cannot be written."""


def check_empty(folder: Path) -> None:
    """Make sure that nothing will be overwritten, before anything is computed.

    Raises:
        FolderError: when the folder holds something, or is none.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderError(f"{folder}: exists and is no folder; name another one")
    if folder.is_dir() and any(folder.iterdir()):
        raise FolderError(f"{folder}: is not empty; name another folder")


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """An empty folder to write files into.

    Raises:
        FolderError: when the folder holds something, or something in it cannot be written.
    """
    check_empty(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
    except OSError as error:
        fault = FolderError(f"{folder}: cannot be written: {error.strerror}")
        raise (machine_error(error, folder) or fault) from None
