# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run reads: measurements, the calibration and the ground truth that go with them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ruledgraph.app.input_options import InputOptions
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.recording import Recording, RecordingError, check_frame_size, open_recording


@dataclass(frozen=True)
class RunInput:
    """Measurements from anywhere, such as a simulation."""

    measurements: Iterable[Measurement]
    calibration: Calibration
    ground_truth: GroundTruth | None = None
    """To compare with at the end."""
    names: Mapping[str, str] = field(default_factory=dict)
    """What the recording, calibration and so on were, for the summary."""

    def warnings(self) -> list[str]:
        """What was wrong with the measurements; asked at the end of a run."""
        return []

    def likely_causes(self) -> list[str]:
        """Why few estimates may be reliable, likeliest first; asked at the end of a run."""
        return []


@dataclass(frozen=True, kw_only=True)
class RecordedInput(RunInput):
    """A recording; it is inspected where it yielded little."""

    path: Path
    recording: Recording
    config: Config
    options: InputOptions

    @classmethod
    def open(cls, path: Path, options: InputOptions, config: Config) -> "RecordedInput":
        """Open a recording, and read its calibration and ground truth.

        Raises:
            RuledgraphError: for whatever of these is missing or no good.
        """
        recording = open_recording(path, **options.choice)
        calibration = options.calibration(path, recording)
        truth = options.ground_truth
        return cls(
            _of_its_size(recording.stream(), calibration, options.calibration_files),
            calibration,
            read_ground_truth(truth, recording) if truth else None,
            {"recording": str(path), **options.summary()},
            path=path,
            recording=recording,
            config=config,
            options=options,
        )

    @property
    def frame_count(self) -> int | None:
        """How many frames there are, where that is known beforehand."""
        topic = self.recording.image_topic
        return None if self.options.is_cropped or not topic else topic.message_count

    def warnings(self) -> list[str]:
        """Of its reader."""
        return self.recording.report.warnings

    def likely_causes(self) -> list[str]:
        """By the checks of `ruledgraph info`."""
        from ruledgraph.app.likely_causes import likely_causes

        return likely_causes(self.path, self.calibration, self.config, self.options.choice)


def _of_its_size(
    measurements: Iterable[Measurement], calibration: Calibration, files: Sequence[str]
) -> Iterator[Measurement]:
    """The same, after a look at the first frame: here the calibration's files are known."""
    rest = iter(measurements)
    for measurement in rest:
        if isinstance(measurement, Frame):
            try:
                check_frame_size(measurement, calibration.camera)
            except RecordingError as error:
                where = ", ".join(files) or "the recording's own calibration"
                raise RecordingError(f"{where}: {error}") from None
        yield measurement
        if isinstance(measurement, Frame):
            break
    yield from rest
