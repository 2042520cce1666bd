# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A long run: does the odometry keep its memory, its speed and its graph's size?

    python tools/soak.py --minutes 60 --out soak

A simulated hand-held camera goes round in a cluttered room, rendered frame by frame and never
stored. Into the folder come soak.csv, a row for every so many seconds of recording, and soak.png.
The exit code is 1 when something grew: the last quarter is compared with the second.
"""

import csv
import gc
import resource
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import click
import numpy as np

from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame
from ruledgraph.integrity.gauge import yaw_alignment
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import Simulation
from ruledgraph.simulation.options import simulation_from_options

# How much the medians of two quarters may differ.
_MEMORY_GROWTH, _TIME_GROWTH, _SLOT_GROWTH = 0.05, 0.15, 0.1


@dataclass(frozen=True)
class Row:
    """What was found over a stretch of recording."""

    time: float
    """Of the recording, s, at its end."""
    memory: float
    """Resident, MB."""
    cost: float
    """Processor time of the odometry per second of recording, s."""
    slots: int
    """Places for factors in the smoother, used or not."""
    variables: int
    """In the smoother."""
    lines: int
    """In the window."""
    error: float
    """Of the live position in the world of the first estimate, m."""
    sigma: float
    """Of that position, the root of its covariance's trace, m."""
    tracking: float
    """Share of the frames with this status."""
    segments: int
    """So far."""
    recoveries: int
    """So far."""
    warnings: int
    """So far."""


def soak(simulation: Simulation, every: float) -> Iterator[Row]:
    """Run a simulation; a row for `every` so many seconds of recording."""
    odometry = Odometry(simulation.calibration)
    window, segments, recoveries = None, 0, 0
    first: Estimate | None = None
    live: list[Estimate] = []
    begin = end = simulation.epoch
    spent = 0.0
    for measurement in simulation.stream():
        started = time.process_time()
        odometry.add(measurement)
        live += odometry.take_live()
        odometry.take_smoothed()
        odometry.take_lines()
        spent += time.process_time() - started
        if odometry.window is not window:
            window = odometry.window
            segments += window is not None
        if not isinstance(measurement, Frame) or measurement.stamp < end + every * 1e9:
            continue
        first = first or next(iter(live), None)
        slots, variables = _size_of_graph(odometry)
        recoveries = len(odometry.recoveries) + (len(window.recoveries) if window else 0)
        yield Row(
            time=(measurement.stamp - begin) * 1e-9,
            memory=_resident(),
            cost=spent / ((measurement.stamp - end) * 1e-9),
            slots=slots,
            variables=variables,
            lines=len(window.lines) if window else 0,
            error=_error(first, live[-1], simulation) if first and live else float("nan"),
            sigma=float(np.sqrt(np.trace(live[-1].covariances[0][3:, 3:])))
            if live
            else float("nan"),
            tracking=float(np.mean([e.status == "tracking" for e in live])) if live else 0.0,
            segments=segments,
            recoveries=recoveries,
            warnings=len(odometry.warnings) + odometry.warnings.left_off,
        )
        end, spent, live = measurement.stamp, 0.0, []


def _size_of_graph(odometry: Odometry) -> tuple[int, int]:
    if odometry.window is None:
        return 0, 0
    # Nobody else has a use for it, so there is no public way to GTSAM's own smoother.
    smoother = odometry.window._solver._smoother._smoother
    return smoother.getFactors().size(), smoother.calculateEstimate().size()


def _resident() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def _error(first: Estimate, last: Estimate, simulation: Simulation) -> float:
    true = simulation.truth([first.stamp, last.stamp])
    turn = yaw_alignment(true.rotation[:1], first.world_T_body.rotation().matrix()[None])
    moved = last.world_T_body.translation() - first.world_T_body.translation()
    truly = true.position[1] - true.position[0]
    return float(np.linalg.norm(turn.rotate(moved) - truly))


def verdicts(rows: Sequence[Row]) -> list[tuple[bool, str]]:
    """Whether it passed, and a line that says so, for everything that must not grow."""
    quarter = len(rows) // 4
    found = []
    for name, limit, unit in (
        ("memory", _MEMORY_GROWTH, "MB"),
        ("cost", _TIME_GROWTH, "s a second"),
        ("slots", _SLOT_GROWTH, ""),
    ):
        values = [float(getattr(row, name)) for row in rows]
        before = float(np.median(values[quarter : 2 * quarter]))
        after = float(np.median(values[-quarter:]))
        growth = after / before - 1.0 if before else float("inf")
        good = growth <= limit
        text = f"{name}: {before:.4g} to {after:.4g} {unit}".strip()
        found.append((good, f"{'ok  ' if good else 'GREW'} {text} ({growth:+.1%})"))
    return found


def draw(rows: Sequence[Row], path: Path) -> None:
    """The rows over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 11), layout="constrained")
    panels = figure.subplots(6, 1, sharex=True)
    minutes = [row.time / 60.0 for row in rows]
    for panel, (label, names) in zip(
        panels,
        {
            "resident memory (MB)": ["memory"],
            "processor time\nper second": ["cost"],
            "in the smoother": ["slots", "variables"],
            "lines": ["lines"],
            "position (m)": ["error", "sigma"],
            "so far": ["segments", "recoveries", "warnings"],
        }.items(),
        strict=True,
    ):
        for name in names:
            panel.plot(minutes, [getattr(row, name) for row in rows], label=name)
        panel.set_ylabel(label)
        panel.set_ylim(bottom=0.0)
        panel.grid(alpha=0.3)
        if len(names) > 1:
            panel.legend(loc="upper left")
    panels[-1].set_xlabel("recording (min)")
    figure.savefig(path, dpi=100)


@click.command(help=__doc__)
@click.option("--minutes", default=60.0, show_default=True, help="Of recording.")
@click.option("--every", default=10.0, show_default=True, help="Seconds of recording of a row.")
@click.option("--resolution", default="320x240", show_default=True)
@click.option("--rate", default=20.0, show_default=True, help="Frames a second.")
@click.option("--scene", default="noncoplanar_cluttered", show_default=True)
@click.option("--seed", default=0, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for results.")
def main(
    minutes: float,
    every: float,
    resolution: str,
    rate: float,
    scene: str,
    seed: int,
    out: Path,
) -> None:
    """Command line."""
    simulation = simulation_from_options(
        scene, "free", resolution=resolution, rate=rate, duration=60.0 * minutes, seed=seed
    )
    out.mkdir(parents=True)
    rows = []
    with (out / "soak.csv").open("x", newline="", buffering=1) as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)])
        writer.writeheader()
        for row in soak(simulation, every):
            writer.writerow(asdict(row))
            rows.append(row)
            if sys.stderr.isatty():
                click.echo(f"\r{row.time:.0f} s of {60.0 * minutes:.0f}", nl=False, err=True)
    if len(rows) < 4:
        raise click.ClickException("too short for a verdict: four rows are the least")
    draw(rows, out / "soak.png")
    found = verdicts(rows)
    for _, text in found:
        click.echo(text)
    last = rows[-1]
    click.echo(
        f"after {last.time / 60.0:.1f} min: {last.error:.3f} m off, {last.segments} segments, "
        f"{last.recoveries} recoveries, {last.warnings} warnings"
    )
    sys.exit(0 if all(good for good, _ in found) else 1)


if __name__ == "__main__":
    main()
