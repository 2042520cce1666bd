# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Tables of numbers in text files, columns apart by commas or blanks, stamps read exactly."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.errors import RuledgraphError

# Digits before the point of the largest stamp, 2^63 ns.
_MAX_DIGITS = {"s": 10, "ns": 19}


class TableError(RuledgraphError):
    """A file that cannot be read or is not the table it should be: names the file and line."""


@dataclass(frozen=True)
class Table:
    """The rows of a file that are not comments, as text."""

    path: Path
    header: list[str]
    """Names of the columns, where the file has any."""
    rows: list[list[str]]
    lines: list[int]
    """Number of each row's line in the file."""
    commas: bool
    """Whether columns are apart by commas."""

    @property
    def width(self) -> int:
        """Number of columns of the first row."""
        return len(self.rows[0])

    def error(self, row: int, problem: str) -> TableError:
        """The error to raise about a row."""
        return TableError(f"{self.path}:{self.lines[row]}: {problem}")

    def numbers(self, columns: Sequence[int]) -> NDArray[np.float64]:
        """These columns, (N, len(columns)); NaN and infinity are numbers."""
        values = np.empty((len(self.rows), len(columns)))
        for i, row in enumerate(self.rows):
            if len(row) != self.width:
                raise self.error(i, f"{len(row)} columns, but {self.width} in the first row")
            try:
                values[i] = [float(row[column]) for column in columns]
            except ValueError as error:
                raise self.error(i, _one_line(error)) from None
        return values

    def stamps(self, column: int, unit: str) -> NDArray[np.int64]:
        """A column of stamps in `s` or `ns`, as ns, (N,); no digit is lost."""
        stamps = np.empty(len(self.rows), dtype=np.int64)
        for i, row in enumerate(self.rows):
            text = row[column]
            try:
                stamps[i] = _nanoseconds(text, unit)
            except (ValueError, OverflowError):
                raise self.error(i, f"{text[:40]!r} is no stamp in {unit}") from None
        return stamps


def _nanoseconds(text: str, unit: str) -> int:
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise ValueError from None
    # Before any arithmetic: an exponent can make it as long as memory.
    if not value.is_finite() or value.adjusted() >= _MAX_DIGITS[unit]:
        raise ValueError
    return int((value.scaleb(9) if unit == "s" else value).to_integral_value())


def read_table(path: Path) -> Table:
    """Read a file with at least one row.

    The last comment before the first row, or a first row that does not begin with a number, names
    the columns.

    Raises:
        TableError: for a file that cannot be read, is no text or has no rows.
    """
    header: list[str] = []
    rows: list[list[str]] = []
    lines: list[int] = []
    commas = False
    for number, line in _lines(path):
        columns = _columns(line.lstrip("#% "))
        if line[0] in "#%" or (not rows and not _is_number(columns[0])):
            header = header if rows else columns
        else:
            commas = commas or ("," in line and not rows)
            rows.append(columns)
            lines.append(number)
    if not rows:
        raise TableError(f"{path}: holds no rows of numbers")
    return Table(path, header, rows, lines, commas)


def read_words(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of a file that are not comments, each with the number of its line.

    Raises:
        TableError: for a file that cannot be read or is no text.
    """
    return ((number, _columns(line)) for number, line in _lines(path) if line[0] not in "#%")


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines that are not empty, with their numbers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise TableError(f"{path}: not a text file") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise TableError(f"{path}: cannot be read: {reason}") from None
    for number, line in enumerate(text.split("\n"), 1):
        if stripped := line.strip():
            yield number, stripped


def _columns(line: str) -> list[str]:
    if "," in line:
        return [column.strip() for column in line.removesuffix(",").split(",")]
    return line.split() or [""]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _one_line(error: Exception) -> str:
    return str(error).replace("\n", " ")[:80]
