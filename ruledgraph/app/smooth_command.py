# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth`: finds what it needs, runs it, and says what came of it."""

import ctypes
import dataclasses
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import cv2

from ruledgraph.app.batch.jobs import filled
from ruledgraph.app.calibration_choice import calibration_for
from ruledgraph.app.options import make_way, make_way_for_results
from ruledgraph.app.outputs import OutputOptions, Outputs
from ruledgraph.app.progress import progress_bar
from ruledgraph.app.results import default_folder
from ruledgraph.app.runner import Source, run
from ruledgraph.app.solvers import Solver
from ruledgraph.app.summary import NO_ESTIMATE
from ruledgraph.app.summary_text import summary_text
from ruledgraph.app.trajectory_files import TrajectoryFormat
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.settings import load_config
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.recording import Recording, RecordingError, check_frame_size, open_recording

_FEW_WARNINGS = 5
# Of glibc's malloc.h.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_NOTHING_ESTIMATED, _BY_SIGNAL = 3, 128
"""Exit codes; to the second the number of the signal is added."""
_STATUS_MEANINGS = {
    NO_ESTIMATE: "before a start, of a start that was discarded, or between two segments",
    "dead reckoning": "too few lines, or all of them parallel: carried by the IMU",
    "degraded": "the IMU is unreliable, images and IMU or lines and estimate disagree, or position "
    "or velocity are too uncertain",
}


def smooth_command(
    recording: Path,
    *,
    calibration_files: Sequence[Path],
    camera: str | None,
    imu: str | None,
    readout: float | None,
    output: Path | None,
    ground_truth: str | None,
    config_file: Path | None,
    settings: Sequence[str],
    time_offset: float | None,
    plots: bool,
    directrices: bool,
    video: Path | None,
    rerun: str | None,
    ros2_bag: Path | None,
    formats: Sequence[TrajectoryFormat],
    solver: Solver,
    force: bool,
    verbose: bool,
    **choice: Any,
) -> None:
    """See `ruledgraph smooth --help`."""
    if solver == "paper":
        given = {
            "--plots": plots,
            "--video": video,
            "--rerun": rerun,
            "--ros2-bag": ros2_bag,
            "--trajectory-format": formats,
            "--config and --set": config_file or settings,
            "--readout": readout,
        }
        if unused := next((option for option, value in given.items() if value), None):
            raise click.UsageError(f"{unused}: the paper's solver has none; leave it out")
    config = load_config(config_file, settings)
    source = open_recording(recording, **choice)
    calibration_files = [Path(filled(str(file), str(recording))) for file in calibration_files]
    calibration = calibration_for(recording, source, calibration_files, camera, imu, readout)
    if time_offset is not None:
        calibration = dataclasses.replace(calibration, time_offset=time_offset)
    if ground_truth:
        ground_truth = filled(ground_truth, str(recording))
    truth = read_ground_truth(ground_truth, source) if ground_truth else None
    output = output or default_folder(recording)
    files = (recording, *calibration_files, ground_truth, config_file)
    inputs = [Path(file) for file in files if file is not None]
    wanted = OutputOptions(plots, directrices, video, rerun, ros2_bag)
    if force:
        make_way(*wanted.replaceable, inputs=inputs)
    cropped = choice["start"] is not None or choice["duration"] is not None
    frames = None if cropped else _frame_count(source)
    with Outputs(wanted, calibration) as outputs:
        _tune_process()
        with progress_bar(frames) as show:
            if force:  # not before all else has proved possible
                make_way_for_results(output, inputs)
            summary = run(
                _of_its_size(source.stream(), calibration, calibration_files),
                calibration,
                config,
                output,
                solver=solver,
                ground_truth=truth,
                inputs=_inputs(
                    recording,
                    calibration_files,
                    ground_truth,
                    choice | {"time_offset": time_offset, "readout": readout},
                ),
                source=_Recorded(recording, source, calibration, config, choice),
                formats=formats,
                observers=[outputs.observe, show],
            )
    outputs.draw(output, truth)
    _tell(summary, output, verbose, outputs.rerun_file)
    for message in outputs.messages():
        click.echo(message, err=True)
    if summary["ended"] == "interrupted":
        # As shells say it: 130 for SIGINT, 143 for SIGTERM.
        click.get_current_context().exit(_BY_SIGNAL + summary.get("signal", signal.SIGINT))
    if not summary["frames_estimated"] and summary["ended"] == "complete":
        click.get_current_context().exit(_NOTHING_ESTIMATED)


@dataclass(frozen=True)
class _Recorded(Source):
    """A recording, which is looked at again where it yielded little."""

    path: Path
    reader: Recording
    calibration: Calibration
    config: Config
    choice: Mapping[str, Any]

    def warnings(self) -> list[str]:
        return self.reader.report.warnings

    def likely_causes(self) -> list[str]:
        from ruledgraph.app.likely_causes import likely_causes

        return likely_causes(self.path, self.calibration, self.config, self.choice)


def _of_its_size(
    measurements: Iterable[Measurement], calibration: Calibration, files: Sequence[Path]
) -> Iterator[Measurement]:
    """The same, after a look at the first frame: here the calibration's files are known."""
    rest = iter(measurements)
    for measurement in rest:
        if isinstance(measurement, Frame):
            try:
                check_frame_size(measurement, calibration.camera)
            except RecordingError as error:
                where = ", ".join(map(str, files)) or "the recording's own calibration"
                raise RecordingError(f"{where}: {error}") from None
        yield measurement
        if isinstance(measurement, Frame):
            break
    yield from rest


def _inputs(
    recording: Path, files: Sequence[Path], ground_truth: str | None, choice: dict[str, Any]
) -> dict[str, str]:
    """What was asked for, as it was written."""
    named = {
        "recording": str(recording),
        "calibration": ", ".join(map(str, files)),
        "ground truth": ground_truth,
        **{name.replace("_", " "): value for name, value in choice.items()},
    }
    return {name: str(value) for name, value in named.items() if value not in (None, "")}


def _frame_count(source: Recording) -> int | None:
    return source.image_topic.message_count if source.image_topic else None


def _tune_process() -> None:
    """Settings of the whole process, which is the command's own."""
    # There are enough threads: OpenCV's own would wait for each other.
    cv2.setNumThreads(1)
    # What goes wrong with a video is said once, at its end, not for each image.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    # Images come and go, and glibc would give their memory back to the kernel and ask for it anew
    # each time, which takes some five to ten per cent of the time.
    with suppress(AttributeError):  # other C libraries have no such function
        c_library = ctypes.CDLL(None)
        c_library.mallopt(_M_MMAP_THRESHOLD, 32 * 2**20)
        c_library.mallopt(_M_TRIM_THRESHOLD, 256 * 2**20)


def _tell(summary: dict[str, Any], output: Path, verbose: bool, rerun: Path | None) -> None:
    if summary["ended"] == "interrupted":
        click.echo("interrupted: the results up to here are written", err=True)
    warnings = summary["warnings"]
    for warning in warnings if verbose else warnings[:_FEW_WARNINGS]:
        click.echo(f"warning: {warning}", err=True)
    rest = summary["warnings_left_off"] + (0 if verbose else len(warnings) - _FEW_WARNINGS)
    if rest > 0:
        click.echo(f"warning: and {rest} more, see {output / 'summary.json'}", err=True)
    for status, meaning in _STATUS_MEANINGS.items():
        if count := summary["status"].get(status, 0):
            click.echo(f"{count} frames {status}: {meaning}")
    if verbose:
        for stage, times in summary["stages"].items():
            click.echo(
                f"{stage}: {times['count']} x {times['mean_ms']:.1f} ms, p99 "
                f"{times['p99_ms']:.1f} ms, max {times['max_ms']:.1f} ms"
            )
    click.echo(summary_text(summary, output, rerun=rerun))
    if not summary["frames_estimated"] and summary["ended"] == "complete":
        click.echo("failed: no frame could be estimated", err=True)
    for cause in summary.get("likely_causes", []):
        click.echo(f"likely cause: {cause}", err=True)
