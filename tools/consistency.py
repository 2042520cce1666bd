# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of the odometry: NEES of all frames over many short simulated runs.

    python tools/consistency.py --out consistency.jsonl
    python tools/consistency.py --flights DATA/euroc_motion --out consistency.jsonl
    python tools/consistency.py --set edges.sigma_px=0.35

Every run has its own motion, noise, biases and texture; of a flight, its own stretch, with the IMU
as it was recorded. The synthetic IMU has the white noise of its data sheet, or, in the runs "noisy
IMU", that which the settings assume of one in motion. NEES, e^T S^-1 e against the truth, is a
degree of freedom's and should be 1 in the mean; where it lies below the reported covariance is too
large, above too small. The median is that of NEES over the median that it should have. The bounds
hold 95 % of what the mean and the median over so many runs are when all is well, with one
independent draw a run. Beyond three sigma there should be 0.3 %. Rows are kept in --out as they
come; a run that was interrupted goes on.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.stats import beta, chi2

from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE, D435I_LIKE
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config, ImuConfig
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.settings import load_config
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import D435I, MeasuredMotion, RecordedImu, Simulation, simulate
from state_nees import nees

SCENE, MOTION = "noncoplanar_cluttered", "free"
NOISY = ", noisy IMU"
"""Ends the name of a start where the IMU has the white noise that is assumed."""
_RENDERED = ("at rest", "in motion", "rolling shutter")
STARTS = (*_RENDERED, *(f"{start}{NOISY}" for start in _RENDERED))
_READOUT = 0.02
FLIGHTS = {"V1_01_easy": "room", "MH_04_difficult": "hall"}
"""With the scene that is rendered."""
CAMERA_OF_FLIGHTS = replace(D435I, imu_noise=ADIS16448_LIKE)
"""A D435i's camera, with the noise figures of the IMU that flew."""
PARTS = ("position", "orientation", "velocity", "gyroscope bias", "accelerometer bias")
DIMENSION = 3
"""Degrees of freedom of each."""
BEYOND = float(chi2.ppf(0.9973, DIMENSION)) / DIMENSION
"""NEES of three sigma."""
# A body that does not move at all has no error to speak of.
_NOTHING = 0.01
# Flights stand on the ground for so long at first, s; frames a second of their camera.
_BEFORE_FLIGHT, _FLIGHT_RATE = 20.0, 20.0


def simulated(start: str, seed: int, seconds: float, rate: float, config: ImuConfig) -> Simulation:
    """A motion of its own in the cluttered scene."""
    noise, name = D435I_LIKE, start.removesuffix(NOISY)
    if name != start:
        noise = noise.at_least(config.min_accelerometer_noise, config.min_gyroscope_noise)
    return simulate(
        SCENE,
        MOTION,
        calibration=D435I.with_readout(_READOUT if name == "rolling shutter" else 0.0),
        rate=rate,
        imu=noise,
        duration=seconds,
        moving_start=name != "at rest",
        seed=seed,
    )


def flown(name: str, seed: int, seconds: float, folder: Path) -> Simulation:
    """A random stretch of a flight with its IMU, in a scene of its own."""
    truth = folder / name / "groundtruth.csv"
    stamps = read_ground_truth(truth).stamps
    latest = float(stamps[-1] - stamps[0]) * 1e-9 - seconds
    begin = float(np.random.default_rng(seed).uniform(_BEFORE_FLIGHT, latest))
    return simulate(
        FLIGHTS[name],
        MeasuredMotion.read(truth, begin, seconds),
        imu=RecordedImu(folder / name / "imu0.csv"),
        calibration=CAMERA_OF_FLIGHTS,
        rate=_FLIGHT_RATE,
        seed=seed,
    )


def run(simulation: Simulation, config: Config) -> dict[str, Any]:
    """NEES of each part of the live and the smoothed estimates, and which were held still."""
    started = time.perf_counter()
    odometry = Odometry(simulation.calibration, config)
    live, smoothed = _estimates(odometry, simulation)
    row: dict[str, Any] = {
        "seconds": time.perf_counter() - started,
        "warnings": list(odometry.warnings),
        "recoveries": list(odometry.recoveries),
        "segments": len({e.segment for e in live}),
    }
    if not live:
        return row
    for kind, estimates in (("live", live), ("smoothed", smoothed)):
        found = nees(estimates, smoothed[0], simulation)
        row[kind] = {"still": [e.status == "still" for e in estimates]}
        row[kind] |= {name: found[name].tolist() for name in PARTS}
    return row


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


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """In Markdown: a line for each start, kind of estimate, whether it is held still, and part."""
    titles = "start | estimates | | runs | part | mean NEES | 95 % | median, of the expected | 95 %"
    lines = [f"| {titles} | off by | beyond 3 sigma, % |", "|" + " --- |" * 11]
    for start in dict.fromkeys(row["start"] for row in rows):
        for kind in ("live", "smoothed"):
            own = [row[kind] for row in rows if row["start"] == start and kind in row]
            for held in (False, True):
                chosen = [found for found in own if held in found["still"]]
                if chosen:
                    what = "held still" if held else "moving"
                    lines += _lines(f"{start} | {kind} | {what}", held, chosen)
    return "\n".join(lines)


def _lines(name: str, held: bool, found: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    of_mean, of_median = bounds(len(found))
    for part in PARTS:
        values = np.concatenate(
            [np.array(row[part])[np.equal(row["still"], held)] for row in found]
        )
        mean = float(values.mean())
        median = float(np.median(values)) * DIMENSION / chi2.median(DIMENSION)
        off = max(median, 1.0 / max(median, _NOTHING))
        yield (
            f"| {name} | {len(found)} | {part} "
            f"| {mean:.2f} | {of_mean[0]:.2f} to {of_mean[1]:.2f} "
            f"| {median:.2f} | {of_median[0]:.2f} to {of_median[1]:.2f} "
            f"| {f'{off:.1f}' if off < 1.0 / _NOTHING else 'far'} "
            f"| {100 * np.mean(values > BEYOND):.1f} |"
        )


def _run(
    case: tuple[str, int], seconds: float, rate: float, flights: Path | None, config: Config
) -> dict[str, Any]:
    start, seed = case
    make: Callable[[], Simulation]
    if start in STARTS:
        make = partial(simulated, start, seed, seconds, rate, config.imu)
    else:
        assert flights is not None  # noqa: S101 - `main` sees to it
        make = partial(flown, start, seed, seconds, flights)
    return {"start": start, "seed": seed} | run(make(), config)


@click.command(help=__doc__.replace("\n\n    ", "\n\n\b\n    ") if __doc__ else None)
@click.option("--runs", default=50, show_default=True, help="Of each start.")
@click.option("--seconds", default=6.0, show_default=True, help="Of a run.")
@click.option("--rate", default=30.0, show_default=True, help="Frames a second, not of flights.")
@click.option(
    "--flights",
    type=click.Path(exists=True, path_type=Path),
    help="Folder with V1_01_easy and MH_04_difficult, each a groundtruth.csv and an imu0.csv.",
)
@click.option(
    "--start",
    "starts",
    type=click.Choice([*STARTS, *FLIGHTS]),
    multiple=True,
    help="Only so; by default all, flights where --flights is given.",
)
@click.option("--set", "settings", multiple=True, help="section.key=value, of the odometry.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--out", type=click.Path(path_type=Path), help="Rows, JSON lines.")
def main(
    runs: int,
    seconds: float,
    rate: float,
    flights: Path | None,
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
    chosen = starts or (*STARTS, *(FLIGHTS if flights else ()))
    if flights is None and not set(STARTS) >= set(chosen):
        raise click.UsageError("flights need --flights, the folder they are in")
    rows: list[dict[str, Any]] = []
    if out is not None and out.exists():
        rows = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    known = {(row["start"], row["seed"]) for row in rows}
    todo = [(start, seed) for seed in range(runs) for start in chosen]
    work = partial(_run, seconds=seconds, rate=rate, flights=flights, config=config)
    for _, row in in_parallel(work, [case for case in todo if case not in known], workers=jobs):
        rows.append(row)
        print(f"{row['start']} {row['seed']}: {row['seconds']:.0f} s", file=sys.stderr, flush=True)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    print(table(rows))
    if without := [f"{row['start']} {row['seed']}" for row in rows if "live" not in row]:
        print(f"no estimate: {', '.join(without)}")


if __name__ == "__main__":
    main()
