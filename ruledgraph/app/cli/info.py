# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph info`."""

from pathlib import Path
from typing import Any

import click

from ruledgraph.app.cli.options import calibration_options, recording_options


@click.command(short_help="Show what a recording holds, and whether it will do.")
@click.argument("recording", type=click.Path(path_type=Path))
@calibration_options
@recording_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--plots",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Draw timing and IMU into this folder.",
)
def info(recording: Path, **options: Any) -> None:
    """Show what a RECORDING holds, what would be used of it, and whether that will do.

    RECORDING is a ROS 1 bag, a ROS 2 bag's folder, an MCAP file or a EuRoC (ASL) folder. All of
    its stamps are read, so damage and gaps show. With a calibration its figures are looked at, too,
    and whether the images turn as the gyroscope does.

    Lines begin with Good, Check (may cost accuracy or a start), Warning (was left out, or looks
    wrong) or Missing (`smooth` cannot do without it). With any Missing the exit code is 2.

    \b
    Examples:
      ruledgraph info flight.bag --duration 30
      ruledgraph info flight.bag --calibration calib.yaml --plots flight_timing
    """
    from ruledgraph.app.info_command import info_command

    info_command(recording, **options)
