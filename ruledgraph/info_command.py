# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph info`: looks at a recording, and at the calibration that is to go with it."""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from ruledgraph.calibration import CalibrationError
from ruledgraph.calibration_choice import calibration_for
from ruledgraph.recording import Recording
from ruledgraph.recording.info import inspect_recording, print_info
from ruledgraph.sensors import Calibration


def info_command(
    recording: Path,
    *,
    calibration_files: Sequence[Path],
    camera: str | None,
    imu: str | None,
    as_json: bool,
    plots: Path | None,
    **choice: Any,
) -> None:
    """See `ruledgraph info --help`."""

    def calibrate(source: Recording) -> Calibration | None:
        brings_its_own = source.kind == "asl" and any(recording.rglob("sensor.yaml"))
        if calibration_files or brings_its_own:
            return calibration_for(recording, source, calibration_files, camera, imu)
        if imu is not None and source.kind != "asl":
            # It may bring its own; if not, there is enough else to look at.
            with suppress(CalibrationError):
                return calibration_for(recording, source, (), camera, imu)
        return None

    found = inspect_recording(recording, calibrate=calibrate, plots=plots, **choice)
    if as_json:
        click.echo(json.dumps(found.as_dict(), indent=2))
    else:
        print_info(found)
