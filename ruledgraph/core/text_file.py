# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Text files that can be read whenever writing ends, for want of space, too."""

from contextlib import suppress
from pathlib import Path

from ruledgraph.core.context import Closing
from ruledgraph.core.errors import MachineError


class AppendOnlyFile(Closing):
    """A new file that is written line by line, each on disk at once and whole.

    Raises:
        OSError: when the file exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = path.open("xb", buffering=0)
        self._size = 0

    def write(self, lines: str) -> int:
        """Append whole lines.

        Returns:
            The number of characters, as other files do.

        Raises:
            MachineError: when they do not fit; nothing of them is left then.
        """
        data = lines.encode()
        try:
            written = 0
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._size)
                self._file.seek(self._size)
            raise MachineError(f"{self.path}: cannot be written: {error.strerror}") from None
        self._size += len(data)
        return len(lines)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that is whole, or is not there; it takes the place of an earlier one.

    Raises:
        MachineError: when it cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise MachineError(f"{path}: cannot be written: {error.strerror}") from None
