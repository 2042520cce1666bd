# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

_Command = TypeVar("_Command", bound=Callable[..., Any])


def recording_options(command: _Command) -> _Command:
    """Which topics of a recording to use, and which stretch of it."""
    for option in reversed(
        (
            click.option("--image-topic", metavar="TOPIC", help="The camera's topic."),
            click.option("--imu-topic", metavar="TOPIC", help="The IMU's topic."),
            click.option(
                "--gyroscope-topic",
                metavar="TOPIC",
                help="The gyroscope's topic, when the accelerometer has one of its own.",
            ),
            click.option("--accelerometer-topic", metavar="TOPIC", help="The accelerometer's."),
            click.option("--start", type=float, help="Begin so many seconds after the beginning."),
            click.option("--duration", type=float, help="Read so many seconds."),
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
                help="Kalibr YAML, EuRoC sensor.yaml or its folder; repeat it for camera and IMU "
                "files. A bag with camera_info and /tf_static can do without.",
            ),
            click.option(
                "--camera", metavar="NAME", help="Which of the calibration's cameras, such as cam0."
            ),
            click.option(
                "--imu",
                type=click.Choice(["d435i", "adis16448"]),
                help="Take this sensor's typical IMU noise, where the calibration has none, as a "
                "bag's own.",
            ),
        )
    ):
        command = option(command)
    return command
