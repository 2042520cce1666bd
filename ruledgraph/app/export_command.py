# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph export`: a recording in another format, with the calibration it brings along."""

from pathlib import Path
from typing import Any

import click

from ruledgraph.app.remove_existing import remove_existing
from ruledgraph.calibration import CalibrationError, read_calibration, write_kalibr
from ruledgraph.calibration.rig import Calibration, Mounting
from ruledgraph.calibration.wide_angle import WIDE_ANGLE
from ruledgraph.recording import (
    Kind,
    Recording,
    RecordingError,
    kind_of,
    open_recording,
    write_recording,
)
from ruledgraph.recording.ros_calibration import recorded_camera


def export_command(
    recording: Path, out: Path, *, kind: Kind | None, force: bool, **choice: Any
) -> None:
    """See `ruledgraph export --help`."""
    kind = kind_of(out, kind)
    source = open_recording(recording, **choice)
    calibration = _brought_along(recording, source)
    # A bag has no place for the IMU's noise, and ROS no word for some cameras.
    beside = None
    if kind != "asl" and isinstance(calibration, Calibration):
        stem = out.stem if out.suffix in (".bag", ".mcap") else out.name
        beside = out.with_name(f"{stem}.calib.yaml")
        if not force and beside.exists():
            raise RecordingError(f"{beside} exists already; remove it or choose another name")
    if force:
        remove_existing(out, *([beside] if beside is not None else []), inputs=[recording])
    fits = calibration is not None and (
        kind == "asl" or calibration.camera.distortion not in WIDE_ANGLE
    )
    frames = source.stream(keep_encoded=True)
    write_recording(frames, out, kind, calibration=calibration if fits else None)
    for warning in source.report.warnings:
        click.echo(f"warning: {warning}", err=True)
    report = source.report
    click.echo(f"{out}: {report.frames.count} frames, {report.imu.count} IMU samples")
    if beside is not None and isinstance(calibration, Calibration):
        write_kalibr(calibration, beside)
        click.echo(f"{beside}: calibration")


def _brought_along(path: Path, source: Recording) -> Calibration | Mounting | None:
    """The calibration in a recording, None where it has none that makes sense."""
    try:
        if source.kind == "asl":
            topic = source.image_topic.name if source.image_topic else None
            return read_calibration(path, image_topic=topic)
        return Mounting(*recorded_camera(source))
    except (CalibrationError, RecordingError):
        return None
