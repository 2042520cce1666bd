# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The files of a run as arrays, for figures."""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import Trajectory, read_tum

# A step between estimates this many times the usual one is a gap.
_GAP = 1.5


@dataclass(frozen=True, eq=False)
class LineTable:
    """`lines.csv`."""

    numbers: list[int]
    ends: FloatArray
    """In the world, m, (L, 2, 3)."""
    sigmas: FloatArray
    """Standard deviation of the worse end, m, (L,)."""
    seen: FloatArray
    """Time of the first and the last sighting, s as in the recording, (L, 2)."""


@dataclass(frozen=True, eq=False)
class RunTables:
    """A results folder of `ruledgraph smooth`."""

    smoothed: Trajectory
    live: Trajectory
    states: dict[str, FloatArray]
    """The numbers of `states.csv`: column -> (K,); NaN where a cell is empty."""
    statuses: list[str]
    """At each state."""
    lines: LineTable
    span: tuple[int, int]
    """Stamps of the first and the last frame of the recording, ns."""

    def vectors(self, name: str) -> FloatArray:
        """Columns `name_x`, `name_y`, `name_z` of the states, (K, 3)."""
        columns = [self.states[f"{name}_{axis}"] for axis in "xyz"]
        return np.stack(columns, axis=1)

    @property
    def times(self) -> FloatArray:
        """Of the states, s since the first frame."""
        return self.states["stamp"] - self.span[0] * 1e-9

    def since_start(self, trajectory: Trajectory) -> FloatArray:
        """Times of poses, s since the first frame."""
        return np.asarray((trajectory.stamps - self.span[0]) * 1e-9, dtype=np.float64)

    def missing(self) -> list[tuple[float, float]]:
        """Where frames have no live estimate: from, to, s since the first frame."""
        stamps = self.live.stamps
        steps = np.diff(stamps)
        usual = float(np.median(steps)) if len(steps) else 0.0
        found = [(int(stamps[i]), int(stamps[i + 1])) for i in np.flatnonzero(steps > _GAP * usual)]
        first, last = self.span
        found += [(first, int(stamps[0])), (int(stamps[-1]), last)]
        return sorted(
            ((a - first) * 1e-9, (b - first) * 1e-9) for a, b in found if b - a > _GAP * usual
        )


def broken(
    times: FloatArray, gaps: Sequence[tuple[float, float]], *rows: FloatArray, hold: bool = False
) -> list[FloatArray]:
    """Times and rows with NaN in gaps, so that nothing is drawn across them.

    Args:
        times: s, (N,), in order.
        gaps: from, to, s.
        rows: of N values.
        hold: whether values last until the gap, as in steps.
    """
    found = [times, *rows]
    # From the last one on: the indices of those before stay.
    for start, stop in sorted(gaps, reverse=True):
        after = int(np.searchsorted(times, 0.5 * (start + stop)))
        if not 0 < after < len(times):
            continue
        last = [start, *(row[after - 1] for row in rows)]
        end = [start, *([np.nan] * len(rows))]
        for point in (end, last) if hold else (end,):
            found = [np.insert(row, after, x) for row, x in zip(found, point, strict=True)]
    return found


def read_run_tables(folder: Path) -> RunTables:
    """Read the trajectories and tables of a run.

    Raises:
        RuledgraphError: when there are no poses, or a table is not that of a run.
    """
    smoothed = read_tum(folder / "trajectory.tum")
    live = read_tum(folder / "trajectory_live.tum")
    lines, states = _rows(folder / "lines.csv"), _rows(folder / "states.csv")
    try:
        statuses = [row.pop("status") for row in states]
        columns = list(states[0]) if states else []
        numbers = {
            name: np.array([float(row[name] or np.nan) for row in states]) for name in columns
        }
        return RunTables(smoothed, live, numbers, statuses, _lines(lines), _span(folder, live))
    except (KeyError, TypeError, ValueError) as error:
        raise RuledgraphError(f"{folder}: its tables are not those of a run: {error}") from None


def _span(folder: Path, live: Trajectory) -> tuple[int, int]:
    """As the summary says; without one, that of the estimates."""
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return int(summary["first_frame_ns"]), int(summary["last_frame_ns"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return int(live.stamps[0]), int(live.stamps[-1])


def _rows(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(encoding="ascii", newline="") as file:
            return list(csv.DictReader(file))
    except (OSError, ValueError, csv.Error) as error:
        raise RuledgraphError(f"{path}: cannot be read: {error}") from None


def _lines(rows: list[dict[str, str]]) -> LineTable:
    ends = [[[float(row[f"{a}{end}"]) for a in "xyz"] for end in (1, 2)] for row in rows]
    variances = [
        [sum(float(row[f"covariance{end}_{c}"]) for c in ("xx", "yy", "zz")) for end in (1, 2)]
        for row in rows
    ]
    seen = [[float(row["first_seen"]), float(row["last_seen"])] for row in rows]
    return LineTable(
        [int(row["line"]) for row in rows],
        np.array(ends, dtype=np.float64).reshape(-1, 2, 3),
        np.sqrt(np.array(variances, dtype=np.float64).reshape(-1, 2).max(axis=1, initial=0.0)),
        np.array(seen, dtype=np.float64).reshape(-1, 2),
    )
