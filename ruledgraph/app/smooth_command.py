# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth`: finds what it needs, runs it, and says what came of it."""

import ctypes
import dataclasses
import signal
import sys
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import click
import cv2
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from ruledgraph.app.batch.jobs import filled
from ruledgraph.app.calibration_choice import calibration_for
from ruledgraph.app.options import make_way, make_way_for_results
from ruledgraph.app.results import default_folder
from ruledgraph.app.summary_text import summary_text
from ruledgraph.app.runner import NO_ESTIMATE, Record, Solver, Watch, run
from ruledgraph.app.runner import Progress as RunProgress
from ruledgraph.app.trajectory_files import TrajectoryFormat
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.settings import load_config
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.odometry import Odometry
from ruledgraph.recording import Recording, RecordingError, check_frame_size, open_recording

_FEW_WARNINGS = 5
# Between lines of progress where there is no terminal, s.
_PROGRESS_INTERVAL = 5.0
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
    if force:
        make_way(*_replaced(video, rerun, ros2_bag), inputs=inputs)
    pictures = None
    if plots:
        from ruledgraph.visualization.plots import PlotRecorder

        pictures = PlotRecorder(calibration.camera)
    cropped = choice["start"] is not None or choice["duration"] is not None
    frames = None if cropped else _frame_count(source)
    log = None
    if rerun is not None:
        from ruledgraph.visualization.rerun_log import RerunLog

        log = RerunLog(rerun, calibration)
    film = None
    if video is not None:
        from ruledgraph.visualization.video import Video

        film = Video(video, calibration.camera)
    _tune_process()
    bag = None
    if ros2_bag is not None:
        from ruledgraph.app.ros_output import Ros2Output

        bag = Ros2Output(ros2_bag, calibration)
    watchers = [watcher.watch for watcher in (pictures, log, film) if watcher is not None]
    records = [output.write for output in (log, bag) if output is not None]
    with (
        _progress_bar(frames) as show,
        log or nullcontext(),
        film or nullcontext(),
        bag or nullcontext(),
    ):
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
            causes=lambda: _causes(recording, calibration, config, choice),
            warnings=lambda: source.report.warnings,
            record=_record(records) if records else None,
            formats=formats,
            watch=_each(watchers) if watchers else None,
            on_progress=show,
        )
    if pictures is not None:
        pictures.draw(output, truth, directrices=directrices)
    logged = log.path if log is not None else None
    _tell(summary, output, verbose, logged if logged is not None and logged.exists() else None)
    if video is not None and video.exists():
        click.echo(f"video: {video}", err=True)
    if bag is not None and bag.path.exists():
        click.echo(f"for RViz and Foxglove: {bag.path}", err=True)
    if summary["ended"] == "interrupted":
        # As shells say it: 130 for SIGINT, 143 for SIGTERM.
        click.get_current_context().exit(_BY_SIGNAL + summary.get("signal", signal.SIGINT))
    if not summary["frames_estimated"] and summary["ended"] == "complete":
        click.get_current_context().exit(_NOTHING_ESTIMATED)


def _replaced(video: Path | None, rerun: str | None, ros2_bag: Path | None) -> list[Path]:
    """The files that --force replaces beside the folder of results."""
    named = (video, ".mp4"), (rerun and Path(rerun), ".rrd"), (ros2_bag, ".mcap")
    return [path for path, suffix in named if path and path.suffix == suffix]


def _each(watchers: Sequence[Watch]) -> Watch:
    def watch(odometry: Odometry, frame: Frame) -> None:
        for watcher in watchers:
            watcher(odometry, frame)

    return watch


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


def _causes(
    recording: Path, calibration: Calibration, config: Config, choice: dict[str, Any]
) -> list[str]:
    from ruledgraph.app.likely_causes import likely_causes

    return likely_causes(recording, calibration, config, choice)


def _record(records: Sequence[Record]) -> Record:
    def record(*handed_out: Any) -> None:
        for each in records:
            each(*handed_out)

    return record


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


@contextmanager
def _progress_bar(total: int | None) -> Iterator[Callable[[RunProgress], None]]:
    """A bar on a terminal, elsewhere a line every few seconds."""
    if not sys.stderr.isatty():
        yield _progress_lines(total)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TaskProgressColumn(show_speed=True),
        TimeRemainingColumn(),
        TextColumn("{task.fields[lines]} lines"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("smoothing", total=total, lines=0)

        def show(state: RunProgress) -> None:
            bar.update(task, completed=state.frames, lines=state.lines, description=state.status)

        yield show


def _progress_lines(total: int | None) -> Callable[[RunProgress], None]:
    said = clock.monotonic()

    def show(state: RunProgress) -> None:
        nonlocal said
        if clock.monotonic() - said >= _PROGRESS_INTERVAL:
            said = clock.monotonic()
            frames = (
                f"{state.frames} frames" if total is None else f"{state.frames} of {total} frames"
            )
            text = f"{frames}, {state.seconds:.1f} s, {state.status}, {state.lines} lines"
            click.echo(text, err=True)

    return show


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
