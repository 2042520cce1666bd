# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A recording begun at many moments: how soon the odometry starts, and how good the start is.

    python tools/benchmark_starts.py flight.bag flight.calib.yaml flight.gt.tum --every 0.5

From each moment on the odometry runs for some seconds, and its live estimates are compared with
ground truth: ATE by evo, SE(3)-aligned without scale, and the scale of a Sim(3) alignment beside
it. A run without a pose counts as a failure of any limit.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import click
import numpy as np

from recorded_runs import Recorded, Run, cell, run_from
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.errors import RuledgraphError

# Limits that are counted, mm; and a start in time, s.
_LIMITS, _SOON = (25.0, 100.0), 1.3


def report(runs: Sequence[Run]) -> str:
    """A line for each run, and what they come to together."""
    lines = [
        f"{'begin (s)':>9} {'delay (s)':>9} {'out (s)':>8} {'frames (%)':>10} {'degraded (%)':>12} "
        f"{'ATE (mm)':>9} {'worst (mm)':>10} {'scale':>7}"
    ]
    lines += [
        (
            f"{run.begin:9.2f} {cell(run.delay, 2):>9} {cell(run.handed_out, 2):>8} "
            f"{100 * run.frames:10.0f} {100 * run.degraded:12.0f} {cell(run.ate, 1):>9} "
            f"{cell(run.worst, 1):>10} {cell(run.scale, 3):>7}"
        )
        for run in runs
    ]
    ates = np.array([np.inf if run.ate is None else run.ate for run in runs])
    delays = np.array([np.inf if run.delay is None else run.delay for run in runs])
    most = np.quantile(ates, 0.9, method="higher")
    lines += [
        "",
        f"{len(runs)} starts: first pose after {np.median(delays):.2f} s (median), "
        f"{np.max(delays):.2f} s at most, {np.mean(delays <= _SOON):.0%} within {_SOON:g} s",
        f"frames with a pose: {np.mean([run.frames for run in runs]):.1%}",
        f"ATE: median {np.median(ates):.1f} mm, 90 % up to {most:.1f} mm, "
        f"worst {np.max(ates):.1f} mm; "
        + ", ".join(f"{np.sum(ates > limit)} over {limit:g} mm" for limit in _LIMITS),
    ]
    return "\n".join(lines)


def _told(run: Run) -> Run:
    error = "no pose" if run.ate is None else f"ATE {run.ate:.1f} mm"
    click.echo(f"begun at {run.begin:g} s: {error}, after {cell(run.delay, 2)} s", err=True)
    return run


@click.command(help=__doc__)
@click.argument("bag", type=click.Path(exists=True))
@click.argument("calibration", type=click.Path(exists=True))
@click.argument("truth", type=click.Path(exists=True))
@click.option("--first", default=0.0, show_default=True, help="First moment, s.")
@click.option("--last", default=22.5, show_default=True, help="Last moment, s.")
@click.option("--every", default=0.5, show_default=True, help="From one to the next, s.")
@click.option("--duration", default=8.0, show_default=True, help="Of each run, s.")
@click.option("--processes", default=1, show_default=True, help="Runs at a time.")
@click.option("--set", "settings", multiple=True, help="section.key=value, as of smooth.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write all runs here.")
def main(
    bag: str,
    calibration: str,
    truth: str,
    first: float,
    last: float,
    every: float,
    duration: float,
    processes: int,
    settings: tuple[str, ...],
    json_file: Path | None,
) -> None:
    """Command line."""
    moments = np.arange(first, last + 1e-6, every).tolist()
    one = partial(run_from, Recorded(bag, calibration, truth, settings), duration)
    try:
        runs = [_told(run) for _, run in in_parallel(one, moments, workers=processes)]
        runs.sort(key=lambda run: run.begin)
    except RuledgraphError as error:
        click.echo(f"starts: {error}", err=True)
        sys.exit(2)
    print(report(runs))
    if json_file is not None:
        json_file.write_text(json.dumps([asdict(run) for run in runs], indent=1) + "\n")


if __name__ == "__main__":
    main()
