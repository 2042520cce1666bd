# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The tables 1 to 5 of the paper, beside its solver and ruledgraph's on simulated recordings.

    python tools/paper_tables.py --rows rows.jsonl --out tables.md
    python tools/paper_tables.py --table 1 --table 5 --seeds 3
    python tools/paper_tables.py --row linear-parallel --solver paper

A table has a line for each of the paper's, with: the figure that the paper prints, of a real
recording that is not public; the paper's solver as implemented in ruledgraph.baselines.paper; the
factor graph, live and smoothed. The last three are of simulated recordings of like motions (12 s,
90 fps, a D435i's camera and IMU) and can be compared with each other, with the first only in kind.
Results are kept in --rows as they come; a run that was interrupted goes on.
"""

import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.spatial.transform import Rotation

from paper_figures import ROWS, TITLES, Row
from ruledgraph.baselines.paper import PaperOdometry
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import ImuSample
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import accuracy, axis_differences, point_line_distances
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import Simulation, simulate

SOLVERS = ("paper", "graph")
COLUMNS = {
    "printed": "paper, as printed",
    "paper": "paper's solver, ours",
    "live": "factor graph, live",
    "smoothed": "factor graph, smoothed",
}
# Table 5: the two lines with markers, and where along their edges these are.
_MARKED = ("left", "right")
_MARKERS = np.array([0.1, 0.5, 0.9])
# The paper's solver's lines are compared this often, in windows.
_EVERY = 15


@dataclass(frozen=True)
class Case:
    """A row with one seed."""

    row: Row
    seed: int
    duration: float

    def key(self, solver: str) -> str:
        """Names a result."""
        return f"{self.row.scene}/{self.row.motion}/{self.seed}/{self.duration:g}/{solver}"


Sightings = dict[int, list[tuple[int, FloatArray]]]
"""Of each estimated line: stamps, and two points (2, 3) in the estimate's world, m."""


def run(case: Case, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """Simulate once, and give it to the solvers; a result of each."""
    simulation = simulate(case.row.scene, case.row.motion, seed=case.seed, duration=case.duration)
    calibration = simulation.calibration
    running: dict[str, Odometry | PaperOdometry] = {
        name: PaperOdometry(calibration) if name == "paper" else Odometry(calibration)
        for name in solvers
    }
    taken = {name: _Taken() for name in solvers}
    seconds = dict.fromkeys(solvers, 0.0)
    for measurement in simulation.stream():
        for name, odometry in running.items():
            started = time.perf_counter()
            odometry.add(measurement)
            seconds[name] += time.perf_counter() - started
            if not isinstance(measurement, ImuSample):
                taken[name].take(odometry)
    for name, odometry in running.items():
        odometry.finish()
        taken[name].take(odometry)
    truth = _truth(simulation)
    results = []
    for name in solvers:
        result: dict[str, Any] = {"key": case.key(name), "seconds": round(seconds[name], 1)}
        try:
            result |= taken[name].figures(name, simulation, truth, case.row.table == 5)
        except RuledgraphError as error:
            result["failed"] = str(error)
        results.append(result)
    return results


class _Taken:
    """What came out of a solver."""

    def __init__(self) -> None:
        self.live: list[Estimate] = []
        self.smoothed: list[Estimate] = []
        self.lines: Sightings = {}
        self._windows = 0

    def take(self, odometry: Odometry | PaperOdometry) -> None:
        self.live += odometry.take_live()
        self.smoothed += odometry.take_smoothed()
        segments = odometry.take_lines()
        if isinstance(odometry, PaperOdometry):
            for rulings in odometry.take_rulings():
                if self._windows % _EVERY == 0:
                    for number, ends in enumerate(rulings.ends):
                        self.lines.setdefault(number, []).append((rulings.stamp, ends))
                self._windows += 1
        else:
            for line in segments:
                self.lines.setdefault(line.number, []).append((line.last_stamp, line.ends))

    def figures(
        self, solver: str, simulation: Simulation, truth: GroundTruth, with_lines: bool
    ) -> dict[str, Any]:
        """Mean and deviation by axis, of the distances of two lines, and ATE (RMSE), m."""
        columns = {"paper": self.smoothed} if solver == "paper" else {}
        if solver == "graph":
            columns = {"live": self.live, "smoothed": self.smoothed}
        figures: dict[str, Any] = {}
        for column, estimates in columns.items():
            if len(estimates) < 3:
                raise RuledgraphError("it never started")
            found = axis_differences(
                _trajectory(estimates), truth, simulation.calibration.body_T_cam
            )
            figures[column] = np.stack([found.mean, found.std], axis=1).ravel().tolist()
            figures[f"{column} ate"] = accuracy(_trajectory(estimates), truth).ate_rmse
        if with_lines:
            figures["lines"] = _line_figures(self.lines, self.smoothed, simulation)
        return figures


def _truth(simulation: Simulation) -> GroundTruth:
    true = simulation.ground_truth
    quaternions = Rotation.from_matrix(true.rotation).as_quat()
    return GroundTruth(true.stamps, true.position, quaternions)


def _trajectory(estimates: Sequence[Estimate]) -> Trajectory:
    return Trajectory.from_poses([e.stamp for e in estimates], [e.world_T_body for e in estimates])


def _line_figures(
    lines: Sightings, smoothed: Sequence[Estimate], simulation: Simulation
) -> list[float]:
    """Mean and deviation of the distance of two true lines' markers from the estimated ones.

    As the paper does it in camera coordinates: the estimated line as seen from the estimated
    camera, the markers as seen from the true one. An estimated line stands for the true one whose
    edge it is nearest to.
    """
    poses = {estimate.stamp: estimate.world_T_body for estimate in smoothed}
    in_body = {
        number: [
            (stamp, poses[stamp].transformTo(ends.T).T)
            for stamp, ends in sightings
            if stamp in poses
        ]
        for number, sightings in lines.items()
    }
    figures: list[float] = []
    for bar in _MARKED:
        best: FloatArray | None = None
        for edge in _long_edges(simulation, bar):
            markers = edge[0] + _MARKERS[:, None] * (edge[1] - edge[0])
            for sightings in in_body.values():
                distances = [
                    point_line_distances(_seen(simulation, stamp, markers), ends)
                    for stamp, ends in sightings
                ]
                if distances and (best is None or np.mean(distances) < best.mean()):
                    best = np.array(distances)
        figures += [float("nan")] * 2 if best is None else [float(best.mean()), float(best.std())]
    return figures


def _seen(simulation: Simulation, stamp: int, points: FloatArray) -> FloatArray:
    """Points (N, 3) of the world in the true body frame."""
    true = simulation.truth([stamp])
    return np.asarray((points - true.position[0]) @ true.rotation[0])


def _long_edges(simulation: Simulation, bar: str) -> list[FloatArray]:
    """The edges along a bar, (2, 3) each, m."""
    return [
        ends
        for name, ends in zip(simulation.line_names, simulation.lines, strict=True)
        if name.split(".")[0] == bar and np.linalg.norm(ends[1] - ends[0]) > 0.3
    ]


# -- the report ------------------------------------------------------------------------------------


def report(cases: Sequence[Case], results: Mapping[str, dict[str, Any]]) -> str:
    """All tables as Markdown."""
    blocks = [
        "# The paper's tables\n\n"
        "Position error of the camera by axis of its initial frame, first poses aligned: |mean| ± "
        "standard deviation over a recording, m, averaged over the seeds. Lines: distance of "
        "markers from the estimated, unbounded line.\n\n"
        f"**{COLUMNS['printed']}**: figures of real recordings (RealSense D435i, UR10 or Vicon) "
        "that are not public. The other columns are of **simulated** recordings of like motions: "
        "compare them with each other; with the printed ones only in kind."
    ]
    for table in sorted({case.row.table for case in cases}):
        lines = [f"## Table {table}: {TITLES[table]}", ""]
        lines += [_cells(["motion", "", *COLUMNS.values()]), _rule(2 + len(COLUMNS))]
        for row in _rows_of(table, cases):
            lines += _row_lines(row, cases, results)
        blocks.append("\n".join(lines))
    blocks.append(_summary(cases, results))
    return "\n\n".join(blocks) + "\n"


def _rows_of(table: int, cases: Sequence[Case]) -> list[Row]:
    return list(dict.fromkeys(case.row for case in cases if case.row.table == table))


def _cells(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _rule(columns: int) -> str:
    return "|" + " --- |" * columns


def _row_lines(
    row: Row, cases: Sequence[Case], results: Mapping[str, dict[str, Any]]
) -> Iterator[str]:
    names = ["X", "Y", "Z", *(["line 1", "line 2"] if row.table == 5 else [])]
    columns = []
    for column in COLUMNS:
        found = _figures(row, cases, results, column)
        # NaN where nothing was found: shown as a dash.
        mean = np.abs(found).mean(axis=0) if len(found) else np.full(len(row.printed), np.nan)
        columns.append(mean.reshape(-1, 2))
    for i, name in enumerate(names):
        cells = ["-" if np.isnan(c[i, 0]) else f"{c[i, 0]:.4f} ± {c[i, 1]:.4f}" for c in columns]
        yield _cells([row.name if i == 0 else "", name, *cells])
    wanted = sum(case.row == row for case in cases)
    missing = [
        f"{COLUMNS[column]} {wanted - count} of {wanted}"
        for column in list(COLUMNS)[1:]
        if (count := len(_figures(row, cases, results, column))) < wanted
    ]
    if missing:
        yield _cells(["", "missing", "; ".join(missing), *[""] * (len(COLUMNS) - 1)])


def _figures(
    row: Row, cases: Sequence[Case], results: Mapping[str, dict[str, Any]], column: str
) -> FloatArray:
    """Of the seeds that have them, (S, 6), in table 5 (S, 10)."""
    if column == "printed":
        return np.array([row.printed])
    solver = "paper" if column == "paper" else "graph"
    found = []
    for case in cases:
        if case.row != row:
            continue
        result = results.get(case.key(solver), {})
        if column in result:
            # The graph hands out a line once, when it has left the window.
            lines = result.get("lines", []) if column != "live" else [np.nan] * 4
            found.append([*result[column], *(lines if row.table == 5 else [])])
    return np.array(found, dtype=float)


def _summary(cases: Sequence[Case], results: Mapping[str, dict[str, Any]]) -> str:
    """Root mean square position error of each table's rows, median and worst."""
    lines = [
        "## All rows\n\nRoot mean square position error of a row, m: median / worst of its table.",
        "",
        _cells(["table", *COLUMNS.values()]),
        _rule(1 + len(COLUMNS)),
    ]
    for table in sorted({case.row.table for case in cases}):
        cells = [str(table)]
        for column in COLUMNS:
            errors = []
            for row in _rows_of(table, cases):
                found = _figures(row, cases, results, column)
                if len(found):
                    errors.append(float(np.sqrt(np.mean(np.sum(found[:, :6] ** 2, axis=1)))))
            cells.append(f"{np.median(errors):.4f} / {max(errors):.4f}" if errors else "-")
        lines.append(_cells(cells))
    lines += ["", *_goals(cases, results)]
    return "\n".join(lines)


def _goals(cases: Sequence[Case], results: Mapping[str, dict[str, Any]]) -> Iterator[str]:
    rows = list(dict.fromkeys(case.row for case in cases))
    for column in ("live", "smoothed"):
        fifth, axes, below, both = 0, 0, 0, 0
        ate = []
        for row in rows:
            found = _figures(row, cases, results, column)
            if not len(found):
                continue
            ours = np.abs(found).mean(axis=0)[:6:2]
            fifth += int(np.sum(ours <= np.abs(row.printed[:6:2]) / 5.0))
            axes += 3
            of_row = [results.get(case.key("graph"), {}) for case in cases if case.row == row]
            ate += [result[f"{column} ate"] for result in of_row if column in result]
            theirs = _figures(row, cases, results, "paper")
            if len(theirs):
                both += 1
                size = np.abs(theirs).mean(axis=0)[:6:2]
                below += bool(np.linalg.norm(ours) < np.linalg.norm(size))
        if axes:
            yield (
                f"- {COLUMNS[column]}: mean error at most a fifth of the printed one on {fifth} of "
                f"{axes} axes; smaller than the paper's solver's in {below} of {both} rows; ATE "
                f"(RMSE) {1e3 * np.median(ate):.1f} mm median, {1e3 * max(ate):.1f} mm worst"
            )


def _read(path: Path | None) -> dict[str, dict[str, Any]]:
    if path is None or not path.exists():
        return {}
    rows = (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines())
    return {row["key"]: row for row in rows}


@click.command(help=__doc__)
@click.option("--table", "tables", type=click.IntRange(1, 5), multiple=True, help="By default all.")
@click.option(
    "--row", "motions", multiple=True, metavar="MOTION", help="Rows of this motion alone."
)
@click.option(
    "--solver", "solvers", type=click.Choice(SOLVERS), multiple=True, help="Default: both."
)
@click.option("--seeds", default=1, show_default=True, help="How many.")
@click.option("--duration", default=12.0, show_default=True, help="Of a recording, s.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--rows", "rows_file", type=click.Path(path_type=Path), help="Results, JSON lines.")
@click.option("--out", type=click.Path(path_type=Path), help="The tables; by default printed.")
def main(
    tables: tuple[int, ...],
    motions: tuple[str, ...],
    solvers: tuple[str, ...],
    seeds: int,
    duration: float,
    jobs: int,
    rows_file: Path | None,
    out: Path | None,
) -> None:
    """Command line."""
    chosen = [
        row
        for row in ROWS
        if (not tables or row.table in tables) and (not motions or row.motion in motions)
    ]
    if not chosen:
        raise click.UsageError(f"no such row; motions: {', '.join(r.motion for r in ROWS)}")
    # Free motion 1 and 2 are rows of their own: further seeds keep them apart.
    cases = [Case(row, row.first_seed + 10 * i, duration) for row in chosen for i in range(seeds)]
    results = _read(rows_file)
    wanted = solvers or SOLVERS
    todo = {
        case: missing
        for case in cases
        if (missing := [name for name in wanted if case.key(name) not in results])
    }
    started = time.perf_counter()
    with ProcessPoolExecutor(jobs) as pool:
        futures = {pool.submit(run, case, missing): case for case, missing in todo.items()}
        for done, future in enumerate(as_completed(futures), start=1):
            for result in future.result():
                results[result["key"]] = result
                if rows_file is not None:
                    with rows_file.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(result) + "\n")
                text = f"{result['key']} {result['seconds']} s {result.get('failed', '')}"
                print(f"{done}/{len(todo)} {text}", file=sys.stderr)
            left = (time.perf_counter() - started) / done * (len(todo) - done)
            print(f"{left / 60.0:.0f} min left", file=sys.stderr, flush=True)
    text = report(cases, results)
    if out is None:
        print(text)
    else:
        out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
