# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph export`."""

from pathlib import Path
from typing import Any

import click

from ruledgraph.app.cli.options import force_option, format_option, recording_options


@click.command(short_help="Write a recording in another format.")
@click.argument("recording", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@format_option
@force_option
@recording_options
def export(recording: Path, out: Path, kind: Any, force: bool, **choice: Any) -> None:
    """Write the camera and the IMU of a RECORDING to OUT in another format.

    Frames are written grey, 8 bit, without loss; recorded JPEGs are kept as they are. A
    calibration in the recording is kept: as sensor.yaml in an asl folder, as camera_info and
    /tf_static in a bag. A bag has no place for the noise figures of the IMU: they are written to
    a .calib.yaml beside OUT. OUT must not exist unless --force is given.

    \b
    Examples:
      ruledgraph export flight.bag flight.mcap
      ruledgraph export flight.bag flight_euroc --format asl
    """
    from ruledgraph.app.export_command import export_command

    export_command(recording, out, kind=kind, force=force, **choice)
