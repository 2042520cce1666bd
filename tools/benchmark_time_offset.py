# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset between camera and IMU: what a wrong one costs, and how well it is estimated.

    python tools/benchmark_time_offset.py --data DATA/euroc_MH_01_30s --out offset.jsonl
    python tools/benchmark_time_offset.py --only rest --seeds 5 --ms 0

The stamps of all frames are moved by some ms, so that the offset is minus that. ATE is evo's,
SE(3)-aligned, in mm, of the live trajectory and of the smoothed one, against the truth when the
frames really were taken: what an offset of the output's stamps adds is not in it. `estimate` is the
mean of the last second in ms, less the right one; `sigma` is reported with it; `3s` is the worst
error by three sigmas of all states that were live. Rows are kept in --out as they come; a run that
was interrupted goes on.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

import fault_scenes
import faults
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Measurement
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import accuracy
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import simulate
from ruledgraph.simulation.write import Files, write_simulation

_SHIFTS = (0, -5, 5, -10, 10, -20, 20)
_SECONDS, _RATE = 8.0, 30.0
# Where the real recording is begun: in motion, and at rest before it is lifted.
_REAL = {"real, from mid-motion": 0.0, "real, from mid-air": 7.3}
# The end of a run says how well the offset is known, s.
_END = 1.0
_WAYS = ("false", "true")
_MOVING = {"rest": False, "in motion": True}


@dataclass(frozen=True)
class Case:
    """A recording whose stamps are off, smoothed with or without estimating that."""

    recording: str
    seed: int
    ms: int
    estimate: str

    @property
    def key(self) -> str:
        """Names the row."""
        return f"{self.recording}, seed {self.seed}|{self.ms:+d} ms|{self.estimate}"


def simulated(recording: tuple[str, int], cache: Path) -> fault_scenes.Source:
    """A hand-held camera in a cluttered scene by its name and seed, rendered once into a folder."""
    name, seed = recording
    out = cache / f"offset_{'moving' if _MOVING[name] else 'rest'}_{seed}.bag"
    files = Files.beside(out)
    if not all(path.exists() for path in files):
        for path in files:
            path.unlink(missing_ok=True)
        made = simulate(
            "noncoplanar_cluttered",
            "free",
            rate=_RATE,
            duration=_SECONDS,
            moving_start=_MOVING[name],
            seed=seed,
        )
        write_simulation(made, out, "rosbag1")
    return fault_scenes.Source(files)


def cases(data: Path | None, seeds: int, shifts: Sequence[int]) -> Iterator[Case]:
    """All of them."""
    recordings = [(name, seed) for seed in range(seeds) for name in _MOVING]
    recordings += [(name, 0) for name in _REAL] if data is not None else []
    for name, seed in recordings:
        for ms in shifts:
            for way in _WAYS:
                yield Case(name, seed, ms, way)


def _estimates(
    odometry: Odometry, stream: Iterable[Measurement]
) -> tuple[list[Estimate], list[Estimate]]:
    """Live and smoothed."""
    for measurement in stream:
        odometry.add(measurement)
        odometry.take_lines()
    odometry.finish()
    return odometry.take_live(), odometry.take_smoothed()


def run(case: Case, data: Path | None, cache: Path, settings: Sequence[str]) -> dict[str, Any]:
    """A row of figures."""
    if data is not None and case.recording in _REAL:
        source = fault_scenes.real(data, _REAL[case.recording], _SECONDS)
    else:
        source = simulated((case.recording, case.seed), cache)
    config = load_config(None, [f"time_offset.estimate={case.estimate}", *settings])
    odometry = Odometry(source.calibration, config)
    stream = faults.shifted_frames(1e-3 * case.ms)(source.open().stream())
    live, smoothed = _estimates(odometry, stream)
    row: dict[str, Any] = {"estimated": len(live), "warnings": list(odometry.warnings)}
    row |= {"smoother_ms": 1e3 * odometry.timings["smoother"].mean}
    if not live:
        return row
    shift = case.ms * 10**6
    for name, estimates in (("live", live), ("smoothed", smoothed)):
        stamps = [e.stamp - shift for e in estimates]
        trajectory = Trajectory.from_poses(stamps, [e.world_T_body for e in estimates])
        row[name] = 1e3 * accuracy(trajectory, source.truth).ate_rmse
    right = source.calibration.time_offset - 1e-3 * case.ms
    nodes = [e for e in live if e.at_state]
    error = np.array([e.time_offset.value for e in nodes]) - right
    sigma = np.array([e.time_offset.sigma for e in nodes])
    end = np.array([e.stamp for e in nodes]) > live[-1].stamp - _END * 1e9
    row |= {"estimate": 1e3 * float(error[end].mean()), "sigma": 1e3 * float(sigma[end].mean())}
    row["degraded"] = float(np.mean([e.status == "degraded" for e in live]))
    if case.estimate == "true":
        row["3s"] = float(np.max(np.abs(error) / (3.0 * sigma)))
        row["nees"] = float(np.mean((error[end] / sigma[end]) ** 2))
    return row


_COLUMNS = {
    "live": "{live:.1f}",
    "smoothed": "{smoothed:.1f}",
    "estimate": "{estimate:+.2f}",
    "sigma": "{sigma:.2f}",
    "3s": "{3s:.1f}",
    "degraded": "{degraded:.0%}",
}


def table(rows: dict[str, dict[str, Any]]) -> str:
    """A line for each row."""
    lines = [["case", *_COLUMNS]]
    for key, row in rows.items():
        shown = {name: row.get(name, np.nan) for name in _COLUMNS}
        lines.append([key, *(form.format(**shown) for form in _COLUMNS.values())])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


@click.command(help=__doc__)
@click.option("--data", type=click.Path(exists=True, path_type=Path), help="MH_01_30s's folder.")
@click.option("--only", multiple=True, help="Cases whose name contains this; repeat it for more.")
@click.option("--seeds", default=1, show_default=True, help="Of the simulated recordings.")
@click.option("--ms", "shifts", multiple=True, type=int, help="Instead of 0, 5, 10, 20 both ways.")
@click.option("--set", "settings", multiple=True, metavar="SECTION.KEY=VALUE", help="One setting.")
@click.option(
    "--cache",
    type=click.Path(path_type=Path),
    default=Path(".fault_cache"),
    show_default=True,
    help="Where rendered recordings are kept.",
)
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--out", type=click.Path(path_type=Path), help="Rows, JSON lines.")
def main(
    data: Path | None,
    only: tuple[str, ...],
    seeds: int,
    shifts: tuple[int, ...],
    settings: tuple[str, ...],
    cache: Path,
    jobs: int,
    out: Path | None,
) -> None:
    """Command line."""
    cache.mkdir(parents=True, exist_ok=True)
    rows: dict[str, dict[str, Any]] = {}
    if out is not None and out.exists():
        for line in out.read_text(encoding="utf-8").splitlines():
            key, row = json.loads(line)
            rows[key] = row
    todo = [
        case
        for case in cases(data, seeds, shifts or _SHIFTS)
        if case.key not in rows and (not only or any(word in case.key for word in only))
    ]
    # Several cases share a recording: all are there before the first case begins.
    rendered = {(case.recording, case.seed) for case in todo if case.recording in _MOVING}
    for _ in in_parallel(partial(simulated, cache=cache), sorted(rendered), workers=jobs):
        pass
    work = partial(run, data=data, cache=cache, settings=settings)
    found = {}
    for case, row in in_parallel(work, todo, workers=jobs):
        found[case.key] = row
        click.echo(f"{case.key} {row}", err=True)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps([case.key, row]) + "\n")
    rows |= {case.key: found[case.key] for case in todo}
    click.echo(table(rows))


if __name__ == "__main__":
    main()
