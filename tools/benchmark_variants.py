# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Stretches of the real recordings as other cameras and IMUs would have recorded them.

    python tools/benchmark_variants.py --data DATA --jobs 2

Each change of `variants.py` on four stretches of 9 s: two of MH_01, one of the bedroom with either
calibration. Chance moves single figures by half.
"""

import sys
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from benchmark_recordings import Case, cases
from recorded_runs import Run, cell, run_from
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.core.errors import RuledgraphError
from variants import GLOBAL_SHUTTER_ONLY, VARIANTS

# The whole recordings of a stretch, and where it begins, s.
_STRETCHES = (
    ("MH_01", 0.0),
    ("MH_01", 6.5),
    ("bedroom, refined calibration", 4.0),
    ("bedroom, owner's calibration", 14.0),
)
_LENGTH = 9.0


class Changed(NamedTuple):
    """A stretch with a variant."""

    variant: str
    stretch: int
    case: Case


def changed_stretches(data: Path, cache: Path, only: str) -> list[Changed]:
    """All of them, variant by variant; recordings that `data` lacks are left out."""
    whole = {case.name: case for case in cases(data, cache) if case.duration is None}
    found = []
    for variant in VARIANTS:
        if only not in variant:
            continue
        for i, (name, begin) in enumerate(_STRETCHES):
            rolling = name.startswith("bedroom")
            if name in whole and not (rolling and variant in GLOBAL_SHUTTER_ONLY):
                seed = zlib.crc32(f"{variant} {i}".encode())
                recorded = replace(whole[name].recorded, variant=variant, seed=seed)
                found.append(Changed(variant, i, Case(name, recorded, begin, _LENGTH)))
    return found


def report(rows: Sequence[tuple[Changed, Run]]) -> str:
    """Markdown: a row for each variant."""
    titles = [f"{name}, from {begin:g} s" for name, begin in _STRETCHES]
    lines = [
        f"| | {' | '.join(titles)} | first pose, s, worst | degraded, % |",
        "|---|" + "---:|" * (len(_STRETCHES) + 2),
    ]
    for variant in dict.fromkeys(changed.variant for changed, _ in rows):
        runs = {changed.stretch: run for changed, run in rows if changed.variant == variant}
        errors = [
            f"{cell(runs[i].ate, 1)} / {cell(runs[i].smoothed, 1)}" if i in runs else ""
            for i in range(len(_STRETCHES))
        ]
        delays = [np.inf if run.delay is None else run.delay for run in runs.values()]
        degraded = 100.0 * np.mean([run.degraded for run in runs.values()])
        lines.append(f"| {variant} | {' | '.join(errors)} | {max(delays):.2f} | {degraded:.0f} |")
    return "\n".join(lines)


def _run(changed: Changed) -> Run:
    return run_from(changed.case.recorded, changed.case.duration, changed.case.begin)


@click.command(help=__doc__.replace("\n\n    ", "\n\n\b\n    ") if __doc__ else None)
@click.option("--data", type=click.Path(exists=True, path_type=Path), required=True)
@click.option("--cache", type=click.Path(path_type=Path), default=Path("results/flights"))
@click.option("--only", default="", help="Variants with this in their name.")
@click.option("--jobs", default=1, show_default=True, help="Runs at a time.")
def main(data: Path, cache: Path, only: str, jobs: int) -> None:
    """Command line."""
    rows = []
    try:
        for changed, run in in_parallel(_run, changed_stretches(data, cache, only), workers=jobs):
            rows.append((changed, run))
            click.echo(f"{changed.variant}, {changed.case.name}: {cell(run.ate, 1)} mm", err=True)
    except RuledgraphError as error:
        click.echo(f"benchmark_variants: {error}", err=True)
        sys.exit(2)
    print(report(rows))


if __name__ == "__main__":
    main()
