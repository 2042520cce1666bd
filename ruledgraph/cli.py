# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The `ruledgraph` command. Thin: it parses arguments and calls the package.

Whatever is slow to import is imported where it is used, so that `--help` comes at once.
"""

import json
import platform
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import click

from ruledgraph import __version__
from ruledgraph.errors import RuledgraphError


class _Group(click.Group):
    """Turns the package's errors into one line and exit code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except RuledgraphError as error:
            click.echo(f"ruledgraph: {error}", err=True)
            ctx.exit(2)


def _print_version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted:
        from ruledgraph_factors import active_kernel

        click.echo(
            f"ruledgraph {__version__} ({active_kernel()} kernel, gtsam {version('gtsam')}, "
            f"numpy {version('numpy')}, Python {platform.python_version()})"
        )
        context.exit()


@click.group(cls=_Group, no_args_is_help=True)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the version, the kernel of the factors, and the versions of gtsam, numpy and Python.",
)
def main() -> None:
    """Line-based visual-inertial odometry as a GTSAM backend."""


_Command = TypeVar("_Command", bound=Callable[..., Any])


def _recording_options(command: _Command) -> _Command:
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


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@_recording_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def info(recording: Path, as_json: bool, **choice: Any) -> None:
    r"""Show what a RECORDING holds and what would be used of it.

    RECORDING is a ROS 1 bag, a ROS 2 bag's folder, an MCAP file or a EuRoC (ASL) folder. All of
    its stamps are read, so damage and gaps show.

    \b
    Example:
      ruledgraph info flight.bag --duration 30
    """
    from ruledgraph.recording.info import inspect_recording, print_info

    found = inspect_recording(recording, **choice)
    if as_json:
        click.echo(json.dumps(found.as_dict(), indent=2))
    else:
        print_info(found)


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "kind",
    type=click.Choice(["rosbag1", "rosbag2", "mcap", "asl"]),
    required=True,
    help="rosbag2 is a folder with an sqlite3 file, asl a folder as of EuRoC.",
)
@_recording_options
def export(recording: Path, out: Path, kind: Any, **choice: Any) -> None:
    r"""Write the camera and the IMU of a RECORDING to OUT in another format.

    Frames are written grey, 8 bit, without loss. OUT must not exist.

    \b
    Example:
      ruledgraph export flight.bag flight_euroc --format asl
    """
    from ruledgraph.recording import open_recording, write_recording

    source = open_recording(recording, **choice)
    write_recording(source.stream(), out, kind)
    for warning in source.report.warnings:
        click.echo(f"warning: {warning}", err=True)
    report = source.report
    click.echo(f"{out}: {report.frames.count} frames, {report.imu.count} IMU samples")
