# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

LONGEST_READOUT = 1.0
"""s; above any frame interval in use, so that milliseconds are noticed."""

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


def calibration_options(
    command: _Command,
    without: str = "A bag with camera_info and /tf_static needs none.",
) -> _Command:
    """The calibration that goes with a recording.

    Args:
        command: that gets the options.
        without: says what happens without `--calibration`.
    """
    for option in reversed(
        (
            click.option(
                "--calibration",
                "calibration_files",
                type=click.Path(path_type=Path),
                multiple=True,
                metavar="FILE",
                help="Read Kalibr YAML, EuRoC sensor.yaml or its folder; repeat it for camera and "
                f"IMU files. {without}",
            ),
            click.option(
                "--camera",
                metavar="NAME",
                help="Use this one of the calibration's cameras, such as cam0.",
            ),
            click.option(
                "--imu",
                type=click.Choice(["d435i", "adis16448"]),
                help="Take this sensor's typical IMU noise, where the calibration has none.",
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
