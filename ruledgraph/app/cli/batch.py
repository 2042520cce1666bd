# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph batch`."""

from pathlib import Path
from typing import Any

import click

from ruledgraph.app.cli.options import calibration_options, recording_options


@click.command(short_help="Smooth many recordings with many settings.")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING [RECORDING ...]")
@calibration_options
@click.option(
    "--ground-truth",
    metavar="FILE|TOPIC",
    help="Report errors against this; {folder} and {stem} stand for the recording's, as they do in "
    "--calibration.",
)
@click.option(
    "--config",
    "config_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Read settings of all runs from this YAML file.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="SECTION.KEY=VALUE[,VALUE ...]",
    help="Change one setting; of several values each is tried.",
)
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of seeds that each simulation is run with.",
)
@click.option(
    "--jobs",
    "workers",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="Number of runs at a time on this machine.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run them on the workers of this dask scheduler, such as tcp://host:8786.",
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    default=Path("results/batch"),
    show_default=True,
    help="Write the results into this folder; runs that are complete there are not run again.",
)
@click.option("--force", is_flag=True, help="Run again what is complete.")
@recording_options
def batch(recordings: tuple[str, ...], **options: Any) -> None:
    """Smooth many RECORDINGs, with each choice of settings; needs the package distributed.

    RECORDING is a path, a folder of several, a quoted pattern, a file's URL (as fsspec reads it),
    or a simulation as sim:SCENE:MOTION with options such as ?rate=30&duration=6&resolution=320x240.
    A run that fails does not stop the others; the same command again goes on with what is missing.
    The results folder gets a folder for each run, table.csv, table.md and report.html.

    \b
    Examples:
      ruledgraph batch 'data/**/*.bag' --calibration calib.yaml --jobs 4 \\
          --ground-truth '{folder}/{stem}.gt.tum' --set window.lag=1.5,2,2.5
      ruledgraph batch 'sim:square_cluttered:free?rate=30' --seeds 20 --output monte_carlo
      ruledgraph batch s3://bucket/a.bag --calibration calib.yaml --scheduler tcp://host:8786
    """
    from ruledgraph.app.batch_command import batch_command

    batch_command(recordings, **options)
