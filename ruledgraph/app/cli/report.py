# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph report`: runs on one page."""

from pathlib import Path

import click


@click.command()
@click.argument(
    "runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN [RUN ...]"
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="HTML",
    help="Write this page; by default report.html in RUN, of several runs in the current folder.",
)
@click.option("--force", is_flag=True, help="Overwrite the page.")
@click.option(
    "--ground-truth",
    metavar="FILE|BAG:/TOPIC",
    help="Evaluate all runs against this; by default the page has the errors each run noted.",
)
def report(
    runs: tuple[Path, ...], output: Path | None, force: bool, ground_truth: str | None
) -> None:
    """Put results folders on one HTML page.

    RUN is a results folder of `ruledgraph smooth`. The page holds pictures, the trajectory to turn
    and zoom, errors, status, timings, warnings and settings, of several runs also a table of
    comparison. It is one file that needs no other, and prints.

    \b
    Examples:
      ruledgraph report results/run1
      ruledgraph report results/run1 results/run2 --ground-truth flight.gt.tum --output both.html
    """
    from ruledgraph.evaluation.sources import read_poses
    from ruledgraph.visualization.report import write_report

    if output is None:
        output = (runs[0] if len(runs) == 1 else Path()) / "report.html"
    truth = read_poses(ground_truth) if ground_truth else None
    write_report(runs, output, truth, force=force)
    click.echo(str(output))
