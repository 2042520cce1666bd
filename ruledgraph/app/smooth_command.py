# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth`: finds what it needs, runs it, and says what came of it."""

import ctypes
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

import click
import cv2

from ruledgraph.app import exit_codes
from ruledgraph.app.outputs import Outputs
from ruledgraph.app.progress import progress_bar
from ruledgraph.app.remove_existing import remove_existing, remove_existing_results
from ruledgraph.app.results import FRAMES_FILE, default_folder
from ruledgraph.app.run_input import RecordedInput
from ruledgraph.app.runner import run
from ruledgraph.app.smooth_options import SmoothOptions
from ruledgraph.app.summary import NO_ESTIMATE
from ruledgraph.app.summary_text import summary_text
from ruledgraph.core.settings import load_config

_FEW_WARNINGS = 5
# Of glibc's malloc.h.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_STATUS_MEANINGS = {
    NO_ESTIMATE: "before a start, of a start that was discarded, or between two segments",
    "dead reckoning": "too few lines, or all of them parallel: carried by the IMU",
    "degraded": "the IMU is unreliable, images and IMU or lines and estimate disagree, or position "
    "or velocity are too uncertain",
}


def smooth_command(recording: Path, options: SmoothOptions) -> None:
    """See `ruledgraph smooth --help`."""
    _check_solver(options)
    config = load_config(options.config_file, options.settings)
    options = options.of_recording(recording)
    given = RecordedInput.open(recording, options.inputs, config)
    output = options.output or default_folder(recording)
    files_read = options.files_read(recording)
    if options.force:
        remove_existing(*options.outputs.replaceable, inputs=files_read)
    with Outputs(options.outputs, given.calibration) as outputs:
        _tune_process()
        with progress_bar(given.frame_count) as show:
            if options.force:  # not before all else has proved possible
                remove_existing_results(output, files_read)
            summary = run(
                given,
                config,
                output,
                solver=options.solver,
                formats=options.formats,
                observers=[outputs.observe, show],
            )
    outputs.draw(output, given.ground_truth)
    _tell(summary, output, options.verbose, outputs.rerun_file)
    for message in outputs.messages():
        click.echo(message, err=True)
    if summary["ended"] == "interrupted":
        number = summary.get("signal", signal.SIGINT)
        click.get_current_context().exit(exit_codes.of_signal(number))
    if not summary["frames_estimated"] and summary["ended"] == "complete":
        click.get_current_context().exit(exit_codes.NOTHING_ESTIMATED)


def _check_solver(options: SmoothOptions) -> None:
    """Refuse what the paper's solver has no use for."""
    if options.solver != "paper":
        return
    given = {
        "--plots": options.outputs.plots,
        "--video": options.outputs.video,
        "--rerun": options.outputs.rerun,
        "--ros2-bag": options.outputs.ros2_bag,
        "--trajectory-format": options.formats,
        "--config and --set": options.config_file or options.settings,
        "--readout": options.inputs.readout,
    }
    if unused := next((option for option, value in given.items() if value), None):
        raise click.UsageError(f"{unused}: is not supported by --solver paper")


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
    told = {status: summary["status"].get(status, 0) for status in _STATUS_MEANINGS}
    for status, count in told.items():
        if count:
            noun = "frame" if count == 1 else "frames"
            click.echo(f"{count} {noun} {status}: {_STATUS_MEANINGS[status]}")
    if any(told.values()) and summary["frames_estimated"]:
        click.echo(f"the status of each frame: {output / FRAMES_FILE}")
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
