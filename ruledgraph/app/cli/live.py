# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph live`."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from ruledgraph.app.cli.options import calibration_options, force_option, settings_options


@click.command()
@click.option(
    "--realsense",
    is_flag=True,
    required=True,
    help="Read the connected RealSense camera with an IMU; needs the package pyrealsense2.",
)
@partial(calibration_options, without="Without it the camera's own figures are taken.")
@click.option(
    "--resolution",
    metavar="WxH",
    default="640x480",
    show_default=True,
    help="Take images of this size.",
)
@click.option(
    "--rate",
    type=click.IntRange(min=1),
    default=90,
    show_default=True,
    metavar="HZ",
    help="Rate of the images.",
)
@click.option(
    "--duration",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Stop after this time, not at Ctrl-C.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="MCAP",
    help="Write what the sensors deliver into this recording, with the calibration beside it.",
)
@settings_options
@force_option
def live(realsense: bool, **options: Any) -> None:
    """Estimate the trajectory of a camera while it moves.

    Images are the left infrared camera's, without the projector's dots; stamps are of the camera's
    clock. Without --calibration the maker's figures are taken, and for the IMU's noise those of
    --imu, by default d435i. It prints the pose once a second.

    \b
    Examples:
      ruledgraph live --realsense
      ruledgraph live --realsense --record room.mcap --duration 60
    """
    del realsense  # the only sensor there is
    from ruledgraph.app.live_command import live_command

    live_command(**options)
