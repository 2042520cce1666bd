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
from pathlib import Path
from typing import Any

import click
import numpy as np

from paper_figures import ROWS, TITLES, Row
from paper_runs import SOLVERS, Case, run
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.arrays import FloatArray

COLUMNS = {
    "printed": "paper, as printed",
    "paper": "paper's solver, ours",
    "live": "factor graph, live",
    "smoothed": "factor graph, smoothed",
}


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


def _run(task: tuple[Case, Sequence[str]]) -> list[dict[str, Any]]:
    return run(*task)


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
    work = in_parallel(_run, list(todo.items()), workers=jobs)
    for done, (_, found) in enumerate(work, start=1):
        for result in found:
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
