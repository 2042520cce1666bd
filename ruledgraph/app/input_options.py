# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run reads: the calibration, the truth, and which part of a recording."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ruledgraph.app.calibration_choice import calibration_for
from ruledgraph.calibration.rig import Calibration
from ruledgraph.recording import Recording

_CHOICE = (
    "image_topic",
    "imu_topic",
    "gyroscope_topic",
    "accelerometer_topic",
    "start",
    "duration",
)
"""Parameters of commands that are arguments of `open_recording`, too."""


@dataclass(frozen=True)
class InputOptions:
    """Options of the commands that smooth, by plain values: a batch sends them to other machines.

    In the names of files `{folder}` and `{stem}` stand for those of a recording.
    """

    calibration_files: tuple[str, ...] = ()
    camera: str | None = None
    """One of the calibration's."""
    imu: str | None = None
    """Whose typical noise to take."""
    readout: float | None = None
    """Of an image's rows, instead of the calibration's, s."""
    time_offset: float | None = None
    """Likewise, s."""
    ground_truth: str | None = None
    """A file or a topic."""
    choice: Mapping[str, Any] = field(default_factory=dict)
    """Of topics and a stretch of the recording, arguments of `open_recording`."""

    @classmethod
    def taken_from(cls, given: dict[str, Any]) -> "InputOptions":
        """From the options of a command, by the names of their parameters; they are taken out."""
        own = {f.name: given.pop(f.name) for f in fields(cls) if f.name in given}
        own["calibration_files"] = tuple(map(str, own["calibration_files"]))
        chosen = {name: given.pop(name) for name in _CHOICE}
        known = {name: value for name, value in chosen.items() if value is not None}
        return cls(**own, choice=known)

    def of_recording(self, folder: str, stem: str) -> "InputOptions":
        """The same with the folder and the stem of a recording filled in."""

        def filled(text: str) -> str:
            return text.replace("{folder}", folder).replace("{stem}", stem)

        files = tuple(filled(file) for file in self.calibration_files)
        truth = self.ground_truth and filled(self.ground_truth)
        return replace(self, calibration_files=files, ground_truth=truth)

    @property
    def is_cropped(self) -> bool:
        """Whether but a stretch of the recording is wanted."""
        return "start" in self.choice or "duration" in self.choice

    def calibration(self, path: Path, recording: Recording) -> Calibration:
        """The calibration of a recording at a path.

        Raises:
            RuledgraphError: when there is none, or it is no good.
        """
        files = [Path(file) for file in self.calibration_files]
        return self.corrected(calibration_for(path, recording, files, self.camera, self.imu))

    def corrected(self, calibration: Calibration) -> Calibration:
        """With the readout and the time offset that were given."""
        if self.readout is not None:
            calibration = calibration.with_readout(self.readout)
        if self.time_offset is not None:
            calibration = replace(calibration, time_offset=self.time_offset)
        return calibration

    def summary(self) -> dict[str, str]:
        """What was given, as it was written."""
        named = {
            "calibration": ", ".join(self.calibration_files),
            "ground truth": self.ground_truth,
            **{name.replace("_", " "): value for name, value in self.choice.items()},
            "time offset": self.time_offset,
            "readout": self.readout,
        }
        return {name: str(value) for name, value in named.items() if value not in (None, "")}
