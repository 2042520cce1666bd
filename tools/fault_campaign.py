# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of sensors and calibration against the odometry: does it stand, does it tell?

    python tools/fault_campaign.py --data DATA/euroc_MH_01_30s --out campaign.jsonl
    python tools/fault_campaign.py --only "lens covered"
    python tools/fault_campaign.py --list

Every case runs in a process of its own with a time limit. A row has the ATE (evo's, SE(3)-aligned,
of the live trajectory, mm); the worst live error, in the world of each segment's beginning; `3s`,
that error by the three sigmas that were reported with it (the largest; above 1 is beyond; 2.9 % of
all may be, were all well), and the shares of frames: beyond 3 sigma, and `unreported`: beyond 3
sigma and wrong by more than 30 mm, of the frames called tracking or still. The verdict:

- good: no worse than three times the clean run and 10 mm;
- worse: off, and its covariance says so;
- reported: off beyond what its covariance says, but no more than 1 % of the frames called tracking
  or still are unreported;
- UNREPORTED: more than that;
- none: no estimate, and a warning says why;
- CRASH, HANG.

Rows are kept in --out as they come; a run that was interrupted goes on.
"""

import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

import fault_scenes
from fault_cases import CLEAN, Case, cases, lift_cases, other_camera_case
from reported_errors import UNREPORTED_SHARE, reported_errors, segments_of, trajectory_of
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Gap, Measurement
from ruledgraph.evaluation import accuracy
from ruledgraph.odometry import Odometry
from ruledgraph.recording import Report
from ruledgraph.recording.inertial import mark_gaps

# What may be beyond three sigmas of a Gaussian in three dimensions, and more.
_BEYOND_SHARE = 0.05
# Where saturated sensors end on the recordings that get all faults, rad/s and m/s^2.
_LIMITS = {"simulated": (0.25, 10.5), "real": (0.45, 9.0)}


def run(case: Case, source: fault_scenes.Source) -> dict[str, Any]:
    """Run a case; a row of figures."""
    recording, truth = source.open(), source.truth
    # Judged is where the camera was when a frame was taken, whatever its stamp says.
    truth = replace(truth, stamps=truth.stamps + round(1e9 * case.late))
    calibration = case.calibrate(source.calibration)
    stream: Iterable[Measurement] = case.apply(recording.stream())
    if not case.live:
        stream = mark_gaps((m for m in stream if not isinstance(m, Gap)), Report())
    odometry = Odometry(calibration)
    live: list[Estimate] = []
    smoothed: list[Estimate] = []
    started = time.perf_counter()
    for measurement in stream:
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
        odometry.take_lines()
    odometry.finish()
    live += odometry.take_live()
    smoothed += odometry.take_smoothed()
    row: dict[str, Any] = {
        "seconds": time.perf_counter() - started,
        "frames": recording.report.frames.count,
        "estimated": len(live),
        "segments": len({estimate.segment for estimate in live}),
        "recoveries": len(odometry.recoveries),
        "status": dict(Counter(estimate.status for estimate in live)),
        "warnings": dict(Counter(map(_kind, odometry.warnings))),
        "first warning": next(iter(odometry.warnings), ""),
        "first recovery": next(iter(odometry.recoveries), ""),
    }
    segments = segments_of(live, smoothed)
    if not segments:
        return row
    found = accuracy(trajectory_of(live), truth)
    errors = reported_errors(segments, truth)
    return row | {
        "ate": 1e3 * found.ate_rmse,
        "path": found.path_length,
        "worst": errors.worst,
        "3s": errors.three_sigma,
        "beyond": errors.beyond,
        "unreported": errors.unreported,
    }


def _kind(warning: str) -> str:
    for kind in ("diverged", "no start", "no IMU", "frozen", "disagree", "discarded"):
        if kind in warning:
            return kind
    return warning[:40]


def verdict(row: dict[str, Any], clean: dict[str, Any] | None) -> str:
    """See the head of this file."""
    if "failure" in row:
        return str(row["failure"])
    if "ate" not in row:
        return "none" if row["warnings"] else "NONE, NOT REPORTED"
    if row["unreported"] > UNREPORTED_SHARE:
        return "UNREPORTED"
    best = clean["ate"] if clean and "ate" in clean else 0.0
    if row["ate"] <= 3.0 * best + 10.0:
        return "good"
    return "reported" if row["beyond"] > _BEYOND_SHARE else "worse"


def guarded(key: str, options: Sequence[str], limit: float) -> dict[str, Any]:
    """The row of a case, which a process of its own runs for at most `limit` s.

    Args:
        key: names the case.
        options: of the command line, with which there is such a case.
        limit: see above.
    """
    command = [sys.executable, __file__, *options, "--row", key]
    try:
        child = subprocess.run(  # noqa: S603 - ours
            command, capture_output=True, text=True, timeout=limit, check=False
        )
    except subprocess.TimeoutExpired:
        return {"failure": "HANG", "traceback": f"still at it after {limit} s"}
    if child.returncode:
        said = child.stderr or f"exit code {child.returncode}"
        return {"failure": "CRASH", "traceback": said}
    return dict(json.loads(child.stdout))


def all_cases(data: Path | None, cache: Path, seconds: float) -> list[tuple[Case, Any]]:
    """Cases, and what opens their recordings."""
    found: list[tuple[Case, Any]] = []
    for name in fault_scenes.NAMES:
        chosen = list(cases(name, _LIMITS[name])) if name in _LIMITS else [Case(name, CLEAN)]
        chosen += list(lift_cases(name)) if name == "long rest" else []
        found += [(case, lambda n=name: fault_scenes.cached(n, cache)) for case in chosen]
    if data is not None:
        stretches = {"real": 0.0, "real, from mid-air": 7.3, "real, long rest": 14.0}
        for name, start in stretches.items():
            chosen = list(cases(name, _LIMITS[name])) if name in _LIMITS else [Case(name, CLEAN)]
            chosen += list(lift_cases(name)) if "long rest" in name else []
            if name in _LIMITS and (right := fault_scenes.right_camera(data)) is not None:
                chosen.append(other_camera_case(name, right))
            found += [(c, lambda s=start: fault_scenes.real(data, s, seconds)) for c in chosen]
    return found


_COLUMNS = {
    "fault": "{fault}",
    "verdict": "{verdict}",
    "frames": "{estimated}/{frames}",
    "ATE": "{ate:.1f}",
    "worst": "{worst:.0f}",
    "3s": "{3s:.1f}",
    "beyond": "{beyond:.0%}",
    "unreported": "{unreported:.0%}",
    "status": "{status}",
    "segments": "{segments}",
    "recov.": "{recoveries}",
    "warnings": "{warnings}",
}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """A text table: a block for each recording."""
    lines: list[list[str]] = [list(_COLUMNS)]
    clean = {row["recording"]: row for row in rows if row["fault"] == CLEAN}
    for row in rows:
        shown = dict(row, verdict=verdict(row, clean.get(row["recording"])))
        status = row.get("status", {})
        words = ((w.replace("dead reckoning", "dr"), n) for w, n in status.items())
        shown["status"] = " ".join(f"{word[:5]} {n}" for word, n in words)
        shown["warnings"] = " ".join(f"{n}x {w}" for w, n in row.get("warnings", {}).items())
        shown["fault"] = f"{row['recording']}: {row['fault']}"
        lines.append([_cell(form, shown) for form in _COLUMNS.values()])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _cell(form: str, row: dict[str, Any]) -> str:
    try:
        return form.format(**row)
    except KeyError:
        return "-"


@click.command(help=__doc__)
@click.option("--data", type=click.Path(exists=True, path_type=Path), help="MH_01_30s's folder.")
@click.option("--seconds", default=10.0, show_default=True, help="Of the real recording.")
@click.option("--only", multiple=True, help="Cases whose name contains this; repeat it for more.")
@click.option("--list", "listed", is_flag=True, help="Show all cases.")
@click.option("--row", "key", help="Run one case here and now, and print its row.")
@click.option("--limit", default=180.0, show_default=True, help="Of a case, s.")
@click.option(
    "--cache",
    type=click.Path(path_type=Path),
    default=Path(".fault_cache"),
    show_default=True,
    help="Where rendered recordings are kept.",
)
@click.option("--jobs", default=2, show_default=True, help="Cases at a time.")
@click.option("--out", type=click.Path(path_type=Path), help="Rows, JSON lines.")
def main(
    data: Path | None,
    seconds: float,
    only: tuple[str, ...],
    listed: bool,
    key: str | None,
    limit: float,
    cache: Path,
    jobs: int,
    out: Path | None,
) -> None:
    """Command line."""
    known = all_cases(data, cache, seconds)
    if key is not None:
        row = next(run(case, source()) for case, source in known if case.key == key)
        click.echo(json.dumps(row))
        return
    chosen = [
        case
        for case, _ in known
        if not only or case.fault == CLEAN or any(word in case.key for word in only)
    ]
    if listed:
        click.echo("\n".join(case.key for case in chosen))
        return
    cache.mkdir(parents=True, exist_ok=True)
    rows: dict[str, dict[str, Any]] = {}
    if out is not None and out.exists():
        for line in out.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            rows[f"{row['recording']}: {row['fault']}"] = row
    todo = {case.key: case for case in chosen if case.key not in rows}
    # Several cases share a recording: all are there before the first case begins.
    rendered = {case.recording for case in todo.values()} & set(fault_scenes.NAMES)
    render = partial(fault_scenes.cached, folder=cache)
    for _ in in_parallel(render, sorted(rendered), workers=jobs):
        pass
    options = ["--cache", str(cache), "--seconds", str(seconds)]
    options += ["--data", str(data)] if data is not None else []
    work = partial(guarded, options=options, limit=limit)
    for name, figures in in_parallel(work, list(todo), workers=jobs):
        row = {"recording": todo[name].recording, "fault": todo[name].fault} | figures
        rows[name] = row
        click.echo(f"{name} {row.get('ate', '')} {row.get('failure', '')}", err=True)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    click.echo(table([rows[case.key] for case in chosen]))
    if any("failure" in rows[case.key] for case in chosen):
        sys.exit(1)


if __name__ == "__main__":
    main()
