# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A rolling shutter: what it costs when the readout is known, and when it is ignored.

    python tools/benchmark_readout.py --seeds 3 --processes 2

Rendered recordings, 8 s at 30 Hz, whose rows are read within some ms. ATE is evo's, SE(3)-aligned,
in mm, of the live trajectory and of the smoothed one, against the truth at the stamps: median and
range over the seeds. `known` is smoothed with the readout it was rendered with, `ignored` as if it
had a global shutter. `frames` is the share with an estimate, the least of the seeds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.app.batch.jobs import Job, plan
from ruledgraph.app.batch.work import Outcome, run_job
from ruledgraph.app.input_options import InputOptions

_READOUTS = (0, 10, 20, 30)
_SECONDS, _RATE = 8, 30
_COLUMNS = ("recording", "readout, ms", "shutter", "live ATE, mm", "smoothed ATE, mm", "frames, %")
SCENES = ("noncoplanar_cluttered:free", "room:circular-tilted-rot-z")


@dataclass(frozen=True)
class Case:
    """Recordings of some seeds, smoothed with or without knowing their readout."""

    scene: str
    ms: int
    is_known: bool


def jobs_of(case: Case, seeds: int) -> list[Job]:
    """Its runs."""
    options = f"rate={_RATE}&duration={_SECONDS}&readout={1e-3 * case.ms:g}"
    inputs = InputOptions(readout=None if case.is_known else 0.0)
    return plan([f"sim:{case.scene}?{options}"], inputs, seeds=seeds)


def row(case: Case, outcomes: Sequence[Outcome]) -> list[str]:
    """A line of the table."""
    way = "global" if not case.ms else "known" if case.is_known else "ignored"
    frames = min(_share(outcome.summary) for outcome in outcomes)
    ates = [_of_all(outcomes, name) for name in ("trajectory_live", "trajectory")]
    return [case.scene, str(case.ms), way, *ates, f"{100.0 * frames:.0f}"]


def _share(summary: dict[str, Any]) -> float:
    return float(summary["frames_estimated"] / summary["frames"]) if summary else 0.0


def _of_all(outcomes: Sequence[Outcome], name: str) -> str:
    """Median and range of the ATE, mm; infinite without a trajectory."""
    found = [o.summary.get("accuracy", {}).get(name, {}).get("ate_rmse", np.inf) for o in outcomes]
    ates = 1e3 * np.array(found)
    return f"{np.median(ates):.1f} ({ates.min():.1f} to {ates.max():.1f})"


def table(rows: Sequence[Sequence[str]]) -> str:
    """In Markdown."""
    lines = [_COLUMNS, ["---", "---:", "---", "---:", "---:", "---:"], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


@click.command(help=__doc__)
@click.option("--seeds", default=3, show_default=True, help="Of the recordings.")
@click.option("--ms", "readouts", multiple=True, type=int, help="Instead of 0, 10, 20, 30.")
@click.option("--only", default="", help="Scenes whose name contains this.")
@click.option("--processes", default=1, show_default=True, help="Runs at a time.")
@click.option("--out", type=click.Path(path_type=Path), help="Write the table here, too.")
def main(
    seeds: int, readouts: tuple[int, ...], only: str, processes: int, out: Path | None
) -> None:
    """Command line."""
    cases = [
        Case(scene, ms, is_known)
        for scene in SCENES
        if only in scene
        for ms in readouts or _READOUTS
        for is_known in ((True, False) if ms else (True,))
    ]
    jobs = {case: jobs_of(case, seeds) for case in cases}
    outcomes: dict[str, Outcome] = {}
    for job, outcome in in_parallel(
        run_job, [job for own in jobs.values() for job in own], workers=processes
    ):
        outcomes[job.name] = outcome
        click.echo(f"{len(outcomes)}: {job.name} {outcome.error}", err=True)
    text = table([row(case, [outcomes[job.name] for job in jobs[case]]) for case in cases])
    click.echo(text)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
