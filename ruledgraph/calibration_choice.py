# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a command's options name."""

from collections.abc import Sequence
from pathlib import Path

import click

from ruledgraph.calibration import TYPICAL_IMU_NOISE, CalibrationError, read_calibration
from ruledgraph.recording import Recording, RecordingError
from ruledgraph.recording.own_calibration import recorded_calibration
from ruledgraph.sensors import Calibration, ImuNoise


def calibration_for(
    path: Path,
    recording: Recording,
    files: Sequence[Path],
    camera: str | None,
    imu: str | None,
) -> Calibration:
    """The calibration of the command line's options; an ASL folder brings its own, and a bag may.

    Raises:
        RuledgraphError: when there is none, or it is no good.
    """
    noise = TYPICAL_IMU_NOISE[imu] if imu else None
    if imu:
        click.echo(f"warning: typical IMU noise of a {imu}, not this sensor's own", err=True)
    if not files and recording.kind != "asl":
        return _recorded(path, recording, noise)
    topic = recording.image_topic.name if recording.image_topic else None
    paths = files or [path]
    return read_calibration(*paths, camera=camera, image_topic=topic, imu_noise=noise)


def _recorded(path: Path, recording: Recording, noise: ImuNoise | None) -> Calibration:
    wanted = "pass --calibration FILE, such as Kalibr's camchain with T_cam_imu"
    try:
        calibration = recorded_calibration(
            recording, noise or next(iter(TYPICAL_IMU_NOISE.values()))
        )
    except RecordingError as error:
        raise CalibrationError(
            f"{path}: no calibration; {wanted}, or record camera_info and /tf_static ({error})"
        ) from None
    if noise is None:
        flags = ", ".join(f"--imu {name}" for name in TYPICAL_IMU_NOISE)
        raise CalibrationError(
            f"{path}: no calibration; {wanted}, or to take the recording's own camera_info and "
            f"/tf_static say what IMU it is: {flags}"
        )
    click.echo(
        "warning: camera_info and /tf_static are taken for the calibration; Kalibr's is better",
        err=True,
    )
    return calibration
