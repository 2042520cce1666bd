# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph smooth`."""

import gc
from pathlib import Path
from typing import Any

import click

from ruledgraph.app.cli.options import (
    calibration_options,
    force_option,
    recording_options,
    settings_options,
)


@click.command()
@click.argument(
    "recordings",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    metavar="RECORDING [RECORDING ...]",
)
@calibration_options
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Write the results into this folder, by default results/<name>-<time>.",
)
@click.option(
    "--ground-truth",
    type=click.Path(),
    metavar="FILE|TOPIC",
    help="Report errors against these poses; {folder} and {stem} stand for the recording's.",
)
@settings_options
@click.option(
    "--time-offset",
    type=click.FloatRange(-10.0, 10.0),
    metavar="SECONDS",
    help="Begin with this t_imu - t_cam instead of the calibration's timeshift_cam_imu.",
)
@click.option("--plots", is_flag=True, help="Draw pictures of the results.")
@click.option("--directrices", is_flag=True, help="With --plots, draw the paper's directrices too.")
@click.option(
    "--video",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="MP4",
    help="Write a video of the images with their lines.",
)
@click.option(
    "--rerun",
    metavar="RRD|viewer|URL",
    help="Write a file for the Rerun viewer, or show the run live in a viewer that is started or "
    "runs (rerun+http://HOST:9876/proxy); needs rerun-sdk.",
)
@click.option(
    "--ros2-bag",
    type=click.Path(path_type=Path),
    metavar="MCAP",
    help="Write poses, path, transforms and lines as ROS 2 messages into an MCAP file.",
)
@click.option(
    "--trajectory-format",
    "formats",
    type=click.Choice(["kitti", "euroc"]),
    multiple=True,
    help="Write the trajectories in this format, too; repeat it for both.",
)
@click.option(
    "--solver",
    type=click.Choice(["graph", "paper"]),
    default="graph",
    show_default=True,
    help="Solve with the factor graph, or with the paper's own solver, a slow baseline.",
)
@force_option
@click.option("-v", "--verbose", is_flag=True, help="Say more: all warnings, stage timings.")
@recording_options
def smooth(recordings: tuple[Path, ...], **given: Any) -> None:
    """Estimate the metric trajectory and the lines of a RECORDING.

    RECORDING is what `ruledgraph info` reads. The results folder gets trajectory.tum (smoothed) and
    trajectory_live.tum, states.csv, lines.csv, summary.json and the config.yaml in effect. The exit
    code is 3 when nothing could be estimated.

    Several RECORDINGs, or a folder of them, are smoothed one after the other; the results folder
    gets a folder for each, a table and a page that compares them. A recording that fails does not
    stop the others, and the same command with the same --output goes on with what is missing; the
    exit code is 1 while any has failed.

    \b
    Examples:
      ruledgraph smooth flight.bag --calibration calib.yaml
      ruledgraph smooth MH_01_easy --output run1 --plots \\
          --ground-truth MH_01_easy/mav0/state_groundtruth_estimate0/data.csv
      ruledgraph smooth flight.bag --calibration calib.yaml --set window.lag=2
      ruledgraph smooth flights/ --calibration calib.yaml --ground-truth '{folder}/{stem}.gt.tum'
    """
    # What is imported stays: the garbage collector need not look through it, now or at the end.
    gc.disable()
    from ruledgraph.app.smooth_command import smooth_command
    from ruledgraph.app.smooth_options import SmoothOptions
    from ruledgraph.recording import recordings_in

    gc.freeze()
    gc.enable()
    options = SmoothOptions.from_command_line(given)
    if len(recordings) == 1 and (
        not recordings[0].is_dir() or recordings_in(recordings[0]) in ([], [recordings[0]])
    ):
        smooth_command(recordings[0], options)
        return
    from ruledgraph.app.smooth_several import smooth_several

    smooth_several(recordings, options)
