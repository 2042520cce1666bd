# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run leaves behind. Everything is written as it comes, so that a run can end any time."""

import csv
import io
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ruledgraph.app.line_files import write_obj, write_ply
from ruledgraph.app.trajectory_files import TRAJECTORY_FORMATS, TrajectoryFormat
from ruledgraph.backend.line_merging import merged_lines
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import MachineError, RuledgraphError
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.settings import config_text
from ruledgraph.core.text_file import AppendOnlyFile, write_whole
from ruledgraph.core.trajectory import TumWriter, seconds

_AXES = "xyz"
_STATE_COLUMNS = [
    "stamp",
    *(f"velocity_{a}" for a in _AXES),
    *(f"gyroscope_bias_{a}" for a in _AXES),
    *(f"accelerometer_bias_{a}" for a in _AXES),
    *(f"gravity_in_body_{a}" for a in _AXES),
    *(f"sigma_rotation_{a}" for a in _AXES),
    *(f"sigma_position_{a}" for a in _AXES),
    *(f"sigma_velocity_{a}" for a in _AXES),
    *(f"sigma_gyroscope_bias_{a}" for a in _AXES),
    *(f"sigma_accelerometer_bias_{a}" for a in _AXES),
    "time_offset",
    "sigma_time_offset",
    "nis",
    "nis_dof",
    "lines",
    "status",
    "segment",
]
_FRAME_COLUMNS = ["stamp", "lines", "status", "segment"]
_COVARIANCE = ("xx", "xy", "xz", "yy", "yz", "zz")
_LINE_COLUMNS = [
    "line",
    *(f"{a}{end}" for end in (1, 2) for a in _AXES),
    *(f"covariance{end}_{c}" for end in (1, 2) for c in _COVARIANCE),
    "first_seen",
    "last_seen",
    "points",
    "sightings",
    "segment",
]


FRAMES_FILE = "live_frames.csv"
"""Has the status of each frame."""

# Kept free for what is written at the end, bytes: the poses and lines of the window, and the
# summary that says why it ended, for want of space, too.
_RESERVE = 2**17


def default_folder(recording: Path) -> Path:
    """Where the results of a recording go that has no other place."""
    time = datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S")
    return Path("results") / f"{recording.resolve().stem}-{time}"


class ResultsError(RuledgraphError):
    """A folder that cannot take the results."""


class Results(Closing):
    """The files of a run, in a folder of their own.

    - `trajectory_live.tum`: world_T_body at each frame as known at its time;
    - `trajectory.tum`: the same as each frame left the window;
    - `states.csv`: at each state when it was new: velocity, biases, gravity, standard deviations
      (rotation and position in the body frame), time offset, normalised innovation squared and its
      degrees of freedom, lines in view, status, segment;
    - `live_frames.csv`: of each frame with a live estimate, lines in view, status, segment;
    - `lines.csv`: end points in the world, their covariance, first and last stamp, edge points,
      sightings that were merged, segment; while it runs, lines as they left the window, one
      sighting each, and at the end the map, see `merged_lines`;
    - `lines.ply` and `lines.obj`, at the end: the same map;
    - `formats`: both trajectories in these formats, too, see `trajectory_files`;
    - `config.yaml`: the settings in effect; `summary.json`: see `summarize`.

    Raises:
        ResultsError: when the folder exists and holds something, or cannot be made.
    """

    def __init__(
        self, folder: Path, config: Config, formats: Sequence[TrajectoryFormat] = ()
    ) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise ResultsError(
                    f"{folder}: is not empty; name another folder with --output, or pass --force"
                )
            write_whole(folder / "config.yaml", config_text(config))
            self._reserve = folder / ".reserve"
            with suppress(MachineError):  # without it the end may not be written
                write_whole(self._reserve, bytes(_RESERVE))
            self._live = TumWriter(folder / "trajectory_live.tum")
            self._smoothed = TumWriter(folder / "trajectory.tum")
            self._states = _Table(folder / "states.csv", _STATE_COLUMNS)
            self._frames = _Table(folder / FRAMES_FILE, _FRAME_COLUMNS)
            self._lines = _Table(folder / "lines.csv", _LINE_COLUMNS)
            kinds = [TRAJECTORY_FORMATS[name] for name in formats]
            self._more_live = [kind(folder, "trajectory_live") for kind in kinds]
            self._more_smoothed = [kind(folder, "trajectory") for kind in kinds]
            self._config = config
            self.lines: list[LineEstimate] = []
            """As they left the window; when closed, the map."""
        except OSError as error:
            raise ResultsError(f"{folder}: cannot be written: {error.strerror}") from None

    def write(
        self,
        live: Sequence[Estimate],
        smoothed: Sequence[Estimate],
        lines: Sequence[LineEstimate],
    ) -> None:
        """Append, each file what it can take.

        Raises:
            MachineError: when one is full.
        """
        trouble: MachineError | None = None
        for append, items in (
            (self._append_live, live),
            (self._append_smoothed, smoothed),
            (self._append_line, lines),
        ):
            trouble = _appended(append, items) or trouble
        if trouble is not None:
            raise trouble

    def _append_live(self, estimate: Any) -> None:
        self._live.append(estimate.stamp, estimate.world_T_body)
        for file in self._more_live:
            file.append(estimate)
        self._frames.write(_frame_row(estimate))
        if estimate.at_state:
            self._states.write(_state_row(estimate, self._config.imu.gravity_in_world))

    def _append_smoothed(self, estimate: Any) -> None:
        self._smoothed.append(estimate.stamp, estimate.world_T_body)
        for file in self._more_smoothed:
            file.append(estimate)

    def _append_line(self, line: Any) -> None:
        self.lines.append(line)
        self._lines.write(_line_row(line))

    def use_reserve(self) -> None:
        """Give back the space that was kept for the end."""
        with suppress(OSError):
            self._reserve.unlink()

    def summarize(self, summary: dict[str, Any]) -> None:
        """Write `summary.json`.

        Raises:
            MachineError: when it cannot be written.
        """
        text = json.dumps(summary, indent=2, allow_nan=False)
        write_whole(self.folder / "summary.json", text + "\n")

    def close(self) -> None:
        """Close the tables and write the map of lines.

        Raises:
            MachineError: when that does not fit; `lines.csv` stays as it was then.
        """
        self.use_reserve()
        for file in (self._live, self._smoothed, self._states, self._frames, self._lines):
            file.close()
        for more in (*self._more_live, *self._more_smoothed):
            more.close()
        self.lines = merged_lines(self.lines, self._config.map)
        write_whole(self.folder / "lines.csv", _line_table(self.lines))
        ends = np.reshape([line.ends for line in self.lines], (-1, 2, 3))
        write_ply(self.folder / "lines.ply", ends)
        write_obj(self.folder / "lines.obj", ends)


def _appended(append: Callable[[Any], None], items: Sequence[Any]) -> MachineError | None:
    """Append as many as it takes; why not all."""
    try:
        for item in items:
            append(item)
    except MachineError as error:
        return error
    return None


class _Table:
    """A CSV file that grows row by row."""

    def __init__(self, path: Path, columns: list[str]) -> None:
        self._file = AppendOnlyFile(path)
        self._writer = csv.writer(self._file, lineterminator="\n")
        self.write(columns)

    def write(self, row: Sequence[Any]) -> None:
        self._writer.writerow(row)

    def close(self) -> None:
        self._file.close()


def _frame_row(estimate: Estimate) -> list[Any]:
    return [seconds(estimate.stamp), estimate.lines, estimate.status, estimate.segment]


def _state_row(estimate: Estimate, gravity: FloatArray) -> list[Any]:
    attitude = estimate.world_T_body.rotation()
    pose, velocity, bias = (np.sqrt(np.diag(c)) for c in estimate.covariances)
    numbers = np.concatenate(
        [
            estimate.velocity,
            estimate.bias.gyroscope(),
            estimate.bias.accelerometer(),
            attitude.unrotate(gravity),
            pose,
            velocity,
            bias[3:],
            bias[:3],
            estimate.time_offset,
        ]
    )
    shown = [f"{number:.9g}" for number in numbers]
    innovation = estimate.innovation
    shown += ["", ""] if innovation is None else [f"{innovation.nis:.9g}", f"{innovation.dof}"]
    return [seconds(estimate.stamp), *shown, estimate.lines, estimate.status, estimate.segment]


def _line_row(line: LineEstimate) -> list[Any]:
    upper = np.triu_indices(3)
    numbers = np.concatenate([line.ends.ravel(), *(c[upper] for c in line.covariance)])
    shown = [f"{number:.9g}" for number in numbers]
    stamps = (seconds(line.first_stamp), seconds(line.last_stamp))
    return [line.id, *shown, *stamps, line.points, line.sightings, line.segment]


def _line_table(lines: Sequence[LineEstimate]) -> str:
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerows([_LINE_COLUMNS, *(_line_row(line) for line in lines)])
    return table.getvalue()
