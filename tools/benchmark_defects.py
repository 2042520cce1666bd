# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Defects of real recordings, simulated: what each costs, and what is recovered of it.

    python tools/benchmark_defects.py --seeds 3 --processes 2 --rows defects.jsonl
    python tools/benchmark_defects.py --only offset --only turned --seeds 10

Rendered recordings with one defect that the calibration does not tell of; of the frame rate and the
image size it does. Each row is several seeds. ATE is evo's, SE(3)-aligned, in
mm, of the live trajectory and of the smoothed one, against the truth when the frames really were
taken: median and range, `none` for a seed without a pose. `frames` is the share with an estimate,
the least of the seeds; `degraded`, of these, the largest; `first pose`, after the first frame, the
latest. Where the odometry estimates the defect, `recovered` is the median of what it reports at the
end, in the unit of the value; `error` is the largest, from the truth, and `error, sigma` the
largest in its own reported standard deviations; of a rotation that is the whole remaining angle by
the deviation about the worst axis. Below the table is how many of the estimates are within three of
them, in the rows of the defect and in all, where other things are wrong. Rows are kept in --rows as
they come; a run that was interrupted goes on.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from defects import SCENES, Case, Result, Variation, result_of
from ruledgraph.app.batch.cluster import in_parallel

# An estimate this far from the truth, in its own standard deviations, contradicts it.
_CONSISTENT = 3.0


@dataclass(frozen=True)
class Defect:
    """A field of `Variation`, as the table shows it."""

    field: str
    name: str
    values: tuple[float | str, ...]


DEFECTS = (
    Defect("offset_ms", "time offset, ms", (-60, -20, 0, 20, 60)),
    Defect("turned_deg", "camera turned, deg", (0, 1, 2, 3, 5)),
    Defect("moved_mm", "camera moved, mm", (0, 3, 10)),
    Defect("readout_ms", "readout, ms", (0, 10, 20, 30)),
    Defect("focal_percent", "focal length, %", (-3, -1, 0, 1, 3)),
    Defect("imu_noise", "IMU noise, times", (1, 4, 8)),
    Defect("rate", "frame rate, Hz", (5, 10, 20, 30, 60)),
    Defect("size", "image size, px", ("320x240", "376x240", "640x480", "1280x720")),
)
_COLUMNS = (
    *("recording", "defect", "value", "frames, %", "degraded, %", "live ATE, mm"),
    *("smoothed ATE, mm", "first pose, s", "recovered", "error", "error, sigma"),
)


def cells(defect: Defect, results: Sequence[Result]) -> list[str]:
    """What the seeds come to: the columns behind the value."""
    found = [r.recovered[defect.field] for r in results if defect.field in r.recovered]
    recovered = ["", "", ""]
    if found:
        values, errors, sigmas = np.array(found).T
        recovered = [
            f"{np.median(values):.2f}",
            f"{errors.max():.2f}",
            _marked(float(np.max(errors / sigmas))),
        ]
    return [
        f"{100.0 * min(r.frames for r in results):.0f}",
        f"{100.0 * max(r.degraded for r in results):.0f}",
        _spread([r.live for r in results]),
        _spread([r.smoothed for r in results]),
        _number(max(_or_infinite(r.first_pose) for r in results), 2),
        *recovered,
    ]


def _marked(sigmas: float) -> str:
    return f"{sigmas:.1f}" if sigmas <= _CONSISTENT else f"**{sigmas:.1f}**"


def _spread(ates: Sequence[float | None]) -> str:
    """Median and range."""
    values = np.array([_or_infinite(ate) for ate in ates])
    if np.all(np.isinf(values)):
        return "none"
    middle, low, high = (
        _number(float(v), 1) for v in (np.median(values), values.min(), values.max())
    )
    return f"{middle} ({low} to {high})"


def _or_infinite(value: float | None) -> float:
    return np.inf if value is None else value


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "none"


def table(rows: Sequence[Sequence[str]]) -> str:
    """In Markdown."""
    lines = [_COLUMNS, ["---", "---", *["---:"] * (len(_COLUMNS) - 2)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def claim(defect: Defect, results: Sequence[Result], where: str) -> str:
    """How many estimates the truth is consistent with, of the runs with a pose."""
    ran = [r for r in results if r.frames]
    found = [r.recovered[defect.field] for r in ran if defect.field in r.recovered]
    good = sum(error <= _CONSISTENT * sigma for _, error, sigma in found)
    return f"{defect.name}, {where}: {good} of {len(found)} runs within {_CONSISTENT:g} sigma"


def report(
    defects: Sequence[Defect], seeds: int, seconds: float, results: dict[str, Result]
) -> str:
    """The table, and how often the claim holds."""

    def of(defect: Defect, value: float | str, scene: str) -> list[Result]:
        return [results[case.key] for case in _of(defect, value, scene, seeds, seconds)]

    rows = [
        [scene, defect.name, f"{value}", *cells(defect, of(defect, value, scene))]
        for defect in defects
        for scene in SCENES
        for value in defect.values
    ]
    every = [results[case.key] for case in cases(defects, seeds, seconds)]
    estimated = {field for result in every for field in result.recovered}
    claims = []
    for defect in defects:
        if defect.field in estimated:
            own = [results[case.key] for case in cases([defect], seeds, seconds)]
            claims.append(claim(defect, own, "its own rows"))
            claims.append(claim(defect, every, "all rows"))
    return "\n".join([table(rows), "", *claims])


def _of(defect: Defect, value: float | str, scene: str, seeds: int, seconds: float) -> list[Case]:
    changes: dict[str, Any] = {defect.field: value}
    variation = Variation(**changes)
    return [Case(scene, seed, variation, seconds) for seed in range(seeds)]


def cases(defects: Sequence[Defect], seeds: int, seconds: float) -> list[Case]:
    """Each once: the good recording is in all rows where a defect is none."""
    chosen = (
        case
        for defect in defects
        for scene in SCENES
        for value in defect.values
        for case in _of(defect, value, scene, seeds, seconds)
    )
    return list({case.key: case for case in chosen}.values())


@click.command(help=__doc__.replace("\n\n    ", "\n\n\b\n    ") if __doc__ else None)
@click.option("--seeds", default=3, show_default=True, help="Of the recordings.")
@click.option("--seconds", default=8.0, show_default=True, help="Of each recording.")
@click.option("--only", multiple=True, help="Defects whose name contains this; repeat it for more.")
@click.option("--set", "settings", multiple=True, metavar="SECTION.KEY=VALUE", help="One setting.")
@click.option("--processes", default=1, show_default=True, help="Runs at a time.")
@click.option("--rows", type=click.Path(path_type=Path), help="Each run's figures, JSON lines.")
@click.option("--out", type=click.Path(path_type=Path), help="Write the table here, too.")
def main(
    seeds: int,
    seconds: float,
    only: tuple[str, ...],
    settings: tuple[str, ...],
    processes: int,
    rows: Path | None,
    out: Path | None,
) -> None:
    """Command line."""
    defects = [d for d in DEFECTS if not only or any(word in d.name for word in only)]
    results: dict[str, Result] = {}
    if rows is not None and rows.exists():
        for line in rows.read_text(encoding="utf-8").splitlines():
            key, row = json.loads(line)
            results[key] = Result(**row)
    todo = [case for case in cases(defects, seeds, seconds) if case.key not in results]
    work = partial(result_of, settings=settings)
    for number, (case, result) in enumerate(in_parallel(work, todo, workers=processes), 1):
        results[case.key] = result
        ate = _number(_or_infinite(result.live), 1)
        click.echo(f"{number} of {len(todo)}: {case.key}: live ATE {ate} mm", err=True)
        if rows is not None:
            with rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps([case.key, asdict(result)]) + "\n")
    text = report(defects, seeds, seconds, results)
    click.echo(text)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
