# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of the odometry: NEES over many short simulated runs, from rest and in motion.

    python tools/consistency.py --out consistency.jsonl
    python tools/consistency.py --set edges.sigma_px=0.35

Every run has its own motion, noise, biases and texture. NEES, e^T S^-1 e of the live states at all
states against the truth, is a degree of freedom's and should be 1 in the mean; where it lies below
the reported covariance is too large, above too small. The median is that of NEES over the median
that it should have. The bounds hold 95 % of what the mean and the median over so many runs are when
all is well, with one independent draw a run. Rows are kept in --out as they come; a run that was
interrupted goes on.
"""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.stats import beta, chi2

from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.settings import load_config
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import Simulation
from ruledgraph.simulation.options import simulation_from_options
from state_nees import nees

SCENE, MOTION = "noncoplanar_cluttered", "free"
STARTS = {"at rest": False, "in motion": True}
PARTS = ("position", "orientation", "velocity", "gyroscope bias", "accelerometer bias")
DIMENSION = 3
"""Degrees of freedom of each."""
# A body that does not move at all has no error to speak of.
_NOTHING = 0.01


def run(
    seed: int, moving_start: bool, seconds: float, rate: float, config: Config
) -> dict[str, Any]:
    """NEES of each part at each state of a run, and which of them were held still."""
    started = time.perf_counter()
    simulation = simulation_from_options(
        SCENE, MOTION, rate=rate, duration=seconds, moving_start=moving_start, seed=seed
    )
    odometry = Odometry(simulation.calibration, config)
    live, smoothed = _estimates(odometry, simulation)
    row: dict[str, Any] = {
        "seconds": time.perf_counter() - started,
        "warnings": list(odometry.warnings),
        "recoveries": list(odometry.recoveries),
        "segments": len({e.segment for e in live}),
        "still": [e.status == "still" for e in live if e.at_state],
    }
    if not live:
        return row
    found = nees(live, smoothed[0], simulation)
    return row | {name: found[name].tolist() for name in PARTS}


def _estimates(odometry: Odometry, simulation: Simulation) -> tuple[list[Estimate], list[Estimate]]:
    """Live and smoothed."""
    live, smoothed = [], []
    for measurement in simulation.stream():
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
        odometry.take_lines()
    odometry.finish()
    return live + odometry.take_live(), smoothed + odometry.take_smoothed()


def bounds(runs: int) -> tuple[FloatArray, FloatArray]:
    """Of the mean of NEES over so many runs, and of its median over the median it should have."""
    tails = np.array([0.025, 0.975])
    mean = chi2.ppf(tails, DIMENSION * runs) / (DIMENSION * runs)
    # The middle one of independent draws has this rank among all.
    rank = beta.ppf(tails, 0.5 * (runs + 1), 0.5 * (runs + 1))
    return mean, chi2.ppf(rank, DIMENSION) / chi2.median(DIMENSION)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """In Markdown: a line for each start, whether it is held still, and part."""
    lines = [
        "| start | states | runs | | mean NEES | 95 % | median, of the expected | 95 % | off by |",
        "|" + " --- |" * 9,
    ]
    for start in STARTS:
        for held in (False, True):
            chosen = [row for row in rows if row["start"] == start and held in row.get("still", [])]
            if chosen:
                lines += _lines(start, held, chosen)
    return "\n".join(lines)


def _lines(start: str, held: bool, rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    of_mean, of_median = bounds(len(rows))
    for part in PARTS:
        values = np.concatenate([np.array(row[part])[np.equal(row["still"], held)] for row in rows])
        mean = float(values.mean())
        median = float(np.median(values)) * DIMENSION / chi2.median(DIMENSION)
        off = max(median, 1.0 / max(median, _NOTHING))
        yield (
            f"| {start} | {'held still' if held else 'moving'} | {len(rows)} | {part} "
            f"| {mean:.2f} | {of_mean[0]:.2f} to {of_mean[1]:.2f} "
            f"| {median:.2f} | {of_median[0]:.2f} to {of_median[1]:.2f} "
            f"| {f'{off:.1f}' if off < 1.0 / _NOTHING else 'far'} |"
        )


def _run(case: tuple[str, int], seconds: float, rate: float, config: Config) -> dict[str, Any]:
    start, seed = case
    return {"start": start, "seed": seed} | run(seed, STARTS[start], seconds, rate, config)


@click.command(help=__doc__)
@click.option("--runs", default=50, show_default=True, help="Of each start.")
@click.option("--seconds", default=6.0, show_default=True, help="Of a run.")
@click.option("--rate", default=30.0, show_default=True, help="Frames a second.")
@click.option("--start", "starts", type=click.Choice(list(STARTS)), multiple=True, help="Only so.")
@click.option("--set", "settings", multiple=True, help="section.key=value, of the odometry.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--out", type=click.Path(path_type=Path), help="Rows, JSON lines.")
def main(
    runs: int,
    seconds: float,
    rate: float,
    starts: tuple[str, ...],
    settings: tuple[str, ...],
    jobs: int,
    out: Path | None,
) -> None:
    """Command line."""
    try:
        config = load_config(None, settings)
    except RuledgraphError as error:
        raise click.UsageError(str(error)) from None
    rows: list[dict[str, Any]] = []
    if out is not None and out.exists():
        rows = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    known = {(row["start"], row["seed"]) for row in rows}
    todo = [(start, seed) for seed in range(runs) for start in starts or STARTS]
    work = partial(_run, seconds=seconds, rate=rate, config=config)
    for _, row in in_parallel(work, [case for case in todo if case not in known], workers=jobs):
        rows.append(row)
        print(f"{row['start']} {row['seed']}: {row['seconds']:.0f} s", file=sys.stderr, flush=True)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    print(table(rows))
    if without := [f"{row['start']} {row['seed']}" for row in rows if PARTS[0] not in row]:
        print(f"no estimate: {', '.join(without)}")


if __name__ == "__main__":
    main()
