# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a command's options name."""

from collections.abc import Sequence
from pathlib import Path

import click

from ruledgraph.calibration import TYPICAL_IMU_NOISE, CalibrationError, read_calibration
from ruledgraph.sensors import Calibration


def calibration_for(
    recording: Path,
    kind: str,
    image_topic: str | None,
    files: Sequence[Path],
    camera: str | None,
    imu: str | None,
) -> Calibration:
    """The calibration of the command line's options; an ASL folder brings its own."""
    paths = list(files)
    if not paths:
        if kind != "asl":
            raise CalibrationError(
                f"{recording}: no calibration; pass --calibration FILE, such as Kalibr's camchain "
                "with T_cam_imu"
            )
        paths = [recording]
    noise = TYPICAL_IMU_NOISE[imu] if imu else None
    if imu:
        click.echo(f"warning: typical IMU noise of a {imu}, not this sensor's own", err=True)
    return read_calibration(*paths, camera=camera, image_topic=image_topic, imu_noise=noise)
