# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a command's options name."""

from collections.abc import Sequence
from pathlib import Path

import click

from ruledgraph.calibration import TYPICAL_IMU_NOISE, CalibrationError, read_calibration
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.recording import Recording, RecordingError
from ruledgraph.recording.ros_calibration import recorded_camera


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
    wanted = "pass --calibration FILE, such as Kalibr's camchain with T_cam_imu"
    if not files and recording.kind == "asl" and not brings_calibration(path):
        raise CalibrationError(
            f"{path}: no calibration; {wanted}, or add cam0/sensor.yaml and imu0/sensor.yaml"
        )
    if files or recording.kind == "asl":
        topic = recording.image_topic.name if recording.image_topic else None
        return calibration_of_files(files or [path], topic, camera, imu)
    try:
        model, body_T_cam = recorded_camera(recording)
    except RecordingError as error:
        raise CalibrationError(
            f"{path}: no calibration; {wanted}, or record camera_info and /tf_static ({error})"
        ) from None
    if imu is None:
        flags = ", ".join(f"--imu {name}" for name in TYPICAL_IMU_NOISE)
        raise CalibrationError(
            f"{path}: no calibration; {wanted}, or, for the recording's own camera_info and "
            f"/tf_static, say what IMU it is: {flags}"
        )
    if camera is not None:
        raise CalibrationError("--camera chooses among the cameras of --calibration, pass that too")
    click.echo(
        "warning: camera_info and /tf_static are taken for the calibration; Kalibr's is better",
        err=True,
    )
    return Calibration(model, body_T_cam, _typical_noise(imu))


def brings_calibration(folder: Path) -> bool:
    """Whether an ASL folder has EuRoC's `sensor.yaml` files."""
    return any(folder.rglob("sensor.yaml"))


def calibration_of_files(
    files: Sequence[Path],
    image_topic: str | None,
    camera: str | None,
    imu: str | None,
    readout: float | None = None,
) -> Calibration:
    """That of files, and of `--camera`, `--imu` and `--readout`.

    Raises:
        CalibrationError: for anything missing, wrong or implausible.
    """
    noise = _typical_noise(imu) if imu else None
    found = read_calibration(*files, camera=camera, image_topic=image_topic, imu_noise=noise)
    return found if readout is None else found.with_readout(readout)


def _typical_noise(imu: str) -> ImuNoise:
    click.echo(f"warning: typical IMU noise of a {imu}, not this sensor's own", err=True)
    return TYPICAL_IMU_NOISE[imu]
