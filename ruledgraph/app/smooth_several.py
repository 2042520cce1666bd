# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth` of several recordings: a batch without dask, one after the other."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from ruledgraph.app.batch.cluster import run_in_turn
from ruledgraph.app.batch.jobs import plan
from ruledgraph.app.batch_command import smooth_jobs
from ruledgraph.app.results import default_folder
from ruledgraph.app.solvers import Solver
from ruledgraph.app.trajectory_files import TrajectoryFormat


def smooth_several(
    recordings: Sequence[Path],
    *,
    output: Path | None,
    calibration_files: Sequence[Path],
    camera: str | None,
    imu: str | None,
    readout: float | None,
    ground_truth: str | None,
    config_file: Path | None,
    settings: Sequence[str],
    time_offset: float | None,
    plots: bool,
    formats: Sequence[TrajectoryFormat],
    force: bool,
    verbose: bool,  # noqa: ARG001 - the summaries hold all warnings
    directrices: bool,
    video: Path | None,
    rerun: str | None,
    ros2_bag: Path | None,
    solver: Solver,
    **choice: Any,
) -> None:
    """Smooth several recordings one after the other, as a batch does."""
    of_one = {
        "--directrices": directrices,
        "--video": video,
        "--rerun": rerun,
        "--ros2-bag": ros2_bag,
        "--solver paper": solver == "paper",
    }
    if given := next((option for option, value in of_one.items() if value), None):
        raise click.UsageError(f"{given}: goes with one recording; here are several")
    jobs = plan(
        [str(recording) for recording in recordings],
        config_file=config_file,
        settings=settings,
        seeds=1,
        calibration=[str(file) for file in calibration_files],
        ground_truth=ground_truth,
        camera=camera,
        imu=imu,
        choice=choice,
        time_offset=time_offset,
        readout=readout,
        formats=formats,
        plots=plots,
    )
    smooth_jobs(jobs, output or default_folder(recordings[0]), run_in_turn, force=force)
