# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What `ruledgraph smooth` was asked for."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from ruledgraph.app.options import RECORDING_CHOICE, filled
from ruledgraph.app.outputs import OutputOptions
from ruledgraph.app.solvers import Solver
from ruledgraph.app.trajectory_files import TrajectoryFormat


@dataclass(frozen=True)
class SmoothOptions:
    """The options of the command, as they were given."""

    calibration_files: tuple[Path, ...]
    camera: str | None
    """One of the calibration's."""
    imu: str | None
    """Whose typical noise to take."""
    readout: float | None
    """Of an image's rows, instead of the calibration's, s."""
    time_offset: float | None
    """Likewise, s."""
    choice: Mapping[str, Any]
    """Of topics and a stretch of the recording, arguments of `open_recording`."""
    config_file: Path | None
    settings: tuple[str, ...]
    """`section.key=value`."""
    solver: Solver
    ground_truth: str | None
    """A file or a topic."""
    output: Path | None
    """Folder of the results."""
    formats: tuple[TrajectoryFormat, ...]
    outputs: OutputOptions
    force: bool
    verbose: bool

    @classmethod
    def from_command_line(cls, given: Mapping[str, Any]) -> "SmoothOptions":
        """All options by the names of their parameters."""
        rest = dict(given)
        outputs = OutputOptions(**{f.name: rest.pop(f.name) for f in fields(OutputOptions)})
        choice = {name: rest.pop(name) for name in RECORDING_CHOICE}
        return cls(outputs=outputs, choice=choice, **rest)

    def of_recording(self, recording: Path) -> "SmoothOptions":
        """The same with the recording's folder and stem filled in."""
        folder, stem = recording.parent, recording.stem
        files = [Path(filled(str(file), folder, stem)) for file in self.calibration_files]
        truth = self.ground_truth and filled(self.ground_truth, folder, stem)
        return replace(self, calibration_files=tuple(files), ground_truth=truth)

    @property
    def is_cropped(self) -> bool:
        """Whether but a stretch of the recording is wanted."""
        return self.choice["start"] is not None or self.choice["duration"] is not None

    def files_read(self, recording: Path) -> list[Path]:
        """What must not be written over."""
        files = (recording, *self.calibration_files, self.ground_truth, self.config_file)
        return [Path(file) for file in files if file is not None]

    def inputs(self, recording: Path) -> dict[str, str]:
        """What was asked for, as it was written, for the summary."""
        files = ", ".join(map(str, self.calibration_files))
        named = {
            "recording": str(recording),
            "calibration": files,
            "ground truth": self.ground_truth,
            **{name.replace("_", " "): value for name, value in self.choice.items()},
            "time offset": self.time_offset,
            "readout": self.readout,
        }
        return {name: str(value) for name, value in named.items() if value not in (None, "")}
