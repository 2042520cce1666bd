# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph info`: looks at a recording, and at the calibration that is to go with it."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ruledgraph.app import exit_codes
from ruledgraph.app.calibration_choice import brings_calibration, calibration_of_files
from ruledgraph.calibration import TYPICAL_IMU_NOISE
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.calibration.rig import Calibration
from ruledgraph.diagnostics.info import inspect_recording
from ruledgraph.diagnostics.info_text import print_info
from ruledgraph.recording import Kind


def info_command(
    recording: Path,
    *,
    calibration_files: Sequence[Path],
    camera: str | None,
    imu: str | None,
    readout: float | None,
    as_json: bool,
    plots: Path | None,
    **choice: Any,
) -> None:
    """See `ruledgraph info --help`."""

    def calibrate(kind: Kind, image_topic: str | None) -> Calibration | None:
        if not (calibration_files or (kind == "asl" and brings_calibration(recording))):
            return None
        files = calibration_files or [recording]
        return calibration_of_files(files, image_topic, camera, imu, readout)

    noise = TYPICAL_IMU_NOISE.get(imu or "", D435I_LIKE)
    found = inspect_recording(
        recording, calibrate=calibrate, imu_noise=noise, plots=plots, **choice
    )
    if as_json:
        click.echo(json.dumps(found.as_dict(), indent=2))
    else:
        print_info(found)
    if found.missing:
        click.get_current_context().exit(exit_codes.BAD_INPUT)
