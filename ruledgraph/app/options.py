# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Options that several commands share."""

import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from ruledgraph.core.errors import RuledgraphError

# What tells a folder that a command wrote: results, a ROS 2 bag, an ASL folder.
_OF_RESULTS = "trajectory_live.tum"
_MARKS = (_OF_RESULTS, "*.db3", "mav0")

LONGEST_READOUT = 1.0
"""s; above any frame interval in use, so that milliseconds are noticed."""

RECORDING_CHOICE = (
    "image_topic",
    "imu_topic",
    "gyroscope_topic",
    "accelerometer_topic",
    "start",
    "duration",
)
"""The parameters of `recording_options`, which are arguments of `open_recording`, too."""

_Command = TypeVar("_Command", bound=Callable[..., Any])


def recording_options(command: _Command) -> _Command:
    """Which topics of a recording to use, and which stretch of it."""
    for option in reversed(
        (
            click.option("--image-topic", metavar="TOPIC", help="Read images from this topic."),
            click.option("--imu-topic", metavar="TOPIC", help="Read the IMU from this topic."),
            click.option(
                "--gyroscope-topic",
                metavar="TOPIC",
                help="Read the gyroscope from this topic, when the accelerometer has another.",
            ),
            click.option(
                "--accelerometer-topic",
                metavar="TOPIC",
                help="Read the accelerometer from this topic.",
            ),
            click.option(
                "--start",
                type=float,
                metavar="SECONDS",
                help="Begin this long after the recording's beginning.",
            ),
            click.option("--duration", type=float, metavar="SECONDS", help="Read this much of it."),
        )
    ):
        command = option(command)
    return command


def settings_options(command: _Command) -> _Command:
    """The settings of a run."""
    for option in reversed(
        (
            click.option(
                "--config",
                "config_file",
                type=click.Path(path_type=Path),
                metavar="FILE",
                help="Read settings from this YAML file.",
            ),
            click.option(
                "--set",
                "settings",
                multiple=True,
                metavar="SECTION.KEY=VALUE",
                help="Change one setting; repeat it for several.",
            ),
        )
    ):
        command = option(command)
    return command


def calibration_options(command: _Command) -> _Command:
    """The calibration that goes with a recording."""
    for option in reversed(
        (
            click.option(
                "--calibration",
                "calibration_files",
                type=click.Path(path_type=Path),
                multiple=True,
                metavar="FILE",
                help="Read Kalibr YAML, EuRoC sensor.yaml or its folder; repeat it for camera and "
                "IMU files. A bag with camera_info and /tf_static can do without.",
            ),
            click.option(
                "--camera",
                metavar="NAME",
                help="Use this one of the calibration's cameras, such as cam0.",
            ),
            click.option(
                "--imu",
                type=click.Choice(["d435i", "adis16448"]),
                help="Take this sensor's typical IMU noise, where the calibration has none, as a "
                "bag's own.",
            ),
            click.option(
                "--readout",
                type=click.FloatRange(0.0, LONGEST_READOUT),
                metavar="SECONDS",
                help="Rolling shutter: time from an image's first row, which has the stamp, to its "
                "last, instead of the calibration's line_delay; 0 is a global shutter.",
            ),
        )
    ):
        command = option(command)
    return command


def format_option(command: _Command) -> _Command:
    """The format of a recording that is written."""
    return click.option(
        "--format",
        "kind",
        type=click.Choice(["rosbag1", "rosbag2", "mcap", "asl"]),
        help="Write this format, by default what OUT's suffix says; rosbag2 is a folder with an "
        "sqlite3 file, asl one as of EuRoC.",
    )(command)


def force_option(command: _Command) -> _Command:
    """Whether what is there may be overwritten."""
    return click.option(
        "--force", is_flag=True, help="Write over what an earlier command wrote there."
    )(command)


def make_way(*paths: Path, inputs: Iterable[Path] = ()) -> None:
    """Remove files, and folders that hold a recording or a run's results, for new ones.

    Raises:
        RuledgraphError: for a folder of anything else, what holds one of the `inputs` or is one,
            and what cannot be removed.
    """
    _spare(inputs, paths)
    for path in paths:
        _remove(path)


def make_way_for_results(folder: Path, inputs: Iterable[Path]) -> None:
    """Remove a folder of earlier results.

    Raises:
        RuledgraphError: for anything else, what holds one of the `inputs`, and what cannot be
            removed.
    """
    _spare(inputs, [folder])
    is_free = not folder.exists() or (folder.is_dir() and not any(folder.iterdir()))
    if not (is_free or (folder / _OF_RESULTS).exists()):
        raise RuledgraphError(f"{folder}: is no folder of results; --force leaves it alone")
    _remove(folder)


def _spare(inputs: Iterable[Path], paths: Sequence[Path]) -> None:
    for given in inputs:
        for path in paths:
            removed = path.resolve()
            if removed == given.resolve() or removed in given.resolve().parents:
                raise RuledgraphError(
                    f"{path}: {given} is read from there; name another place for what is written"
                )


def _remove(path: Path) -> None:
    try:
        if path.is_file() or path.is_symlink() or not path.exists():
            path.unlink(missing_ok=True)
            return
        if not path.is_dir():
            raise RuledgraphError(f"{path}: is no file; --force leaves it alone")
        if any(path.iterdir()) and not any(any(path.glob(mark)) for mark in _MARKS):
            raise RuledgraphError(
                f"{path}: holds neither a recording nor results; --force leaves it alone"
            )
        shutil.rmtree(path)
    except OSError as error:
        raise RuledgraphError(f"{path}: cannot be removed: {error.strerror}") from None
