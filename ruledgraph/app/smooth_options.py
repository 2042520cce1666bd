# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What `ruledgraph smooth` was asked for."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from ruledgraph.app.input_options import InputOptions
from ruledgraph.app.outputs import OutputOptions
from ruledgraph.app.solvers import Solver
from ruledgraph.app.trajectory_files import TrajectoryFormat


@dataclass(frozen=True)
class SmoothOptions:
    """The options of the command, as they were given."""

    inputs: InputOptions
    config_file: Path | None
    settings: tuple[str, ...]
    """`section.key=value`."""
    solver: Solver
    output: Path | None
    """Folder of the results."""
    formats: tuple[TrajectoryFormat, ...]
    """Of the trajectories, beside TUM's."""
    outputs: OutputOptions
    force: bool
    verbose: bool

    @classmethod
    def from_command_line(cls, given: Mapping[str, Any]) -> "SmoothOptions":
        """All options by the names of their parameters."""
        rest = dict(given)
        outputs = OutputOptions(**{f.name: rest.pop(f.name) for f in fields(OutputOptions)})
        return cls(inputs=InputOptions.taken_from(rest), outputs=outputs, **rest)

    def of_recording(self, recording: Path) -> "SmoothOptions":
        """The same with the recording's folder and stem filled in."""
        inputs = self.inputs.of_recording(str(recording.parent), recording.stem)
        return replace(self, inputs=inputs)

    def files_read(self, recording: Path) -> list[Path]:
        """What must not be written over."""
        files = *self.inputs.calibration_files, self.inputs.ground_truth, self.config_file
        return [recording, *(Path(file) for file in files if file is not None)]
