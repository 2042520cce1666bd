# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The options of `ruledgraph evaluate`."""

from pathlib import Path
from typing import Any

import click


@click.command(short_help="Compare trajectories with a reference: ATE, RPE.")
@click.argument(
    "estimates", nargs=-1, required=True, type=click.Path(), metavar="ESTIMATE [ESTIMATE ...]"
)
@click.argument("reference", type=click.Path())
@click.option("--live", is_flag=True, help="Evaluate trajectory_live.tum of a run's folder.")
@click.option(
    "--align",
    type=click.Choice(["none", "origin", "posyaw", "se3", "sim3"]),
    default="se3",
    show_default=True,
    help="Align by the first pose (origin), position and yaw (posyaw), SE(3) or Sim(3).",
)
@click.option(
    "--tolerance",
    type=float,
    default=0.01,
    show_default=True,
    metavar="SECONDS",
    help="Largest difference of two stamps that make a pair.",
)
@click.option(
    "--length",
    "lengths",
    type=click.FloatRange(min=0.0, min_open=True),
    multiple=True,
    metavar="M",
    help="Compute RPE over this length; repeat it for several. By default 1, 2, 5 and 10 m.",
)
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Show differences by axis of this camera, not of the body.",
)
@click.option(
    "--markers",
    type=click.Path(),
    metavar="FILE|BAG:/TOPIC",
    help="Show how far lines miss these points of true ones, CSV or YAML, named line/marker.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--plots",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Draw all estimates into this folder.",
)
@click.option(
    "--save",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Write evo's result files into this folder, for evo_res.",
)
def evaluate(estimates: tuple[str, ...], reference: str, **options: Any) -> None:
    """Compare one or several ESTIMATEs with a REFERENCE: ATE and RPE by evo.

    Each is a TUM file, EuRoC's CSV, KITTI poses and their times as `poses.txt,times.txt`, the
    results folder of `ruledgraph smooth`, or a topic as `recording.bag:/topic`. Poses are
    associated as evo_ape does it, by nearest stamps, and errors are those it prints.

    \b
    Examples:
      ruledgraph evaluate results/run1 flight.gt.tum
      ruledgraph evaluate results/run1 flight.bag:/vicon/pose --align posyaw --json
      ruledgraph evaluate other.tum flight.gt.tum --length 1 --length 10 --save other_evo
      ruledgraph evaluate results/run1 results/run2 other.tum flight.gt.tum --plots compared
    """
    from ruledgraph.app.evaluate_command import evaluate_command

    evaluate_command(estimates, reference, **options)
