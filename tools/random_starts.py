# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Parts of the real recordings at random: where one begins, which part of the image, which rate.

    python tools/random_starts.py --data DATA --runs 200 --jobs 2 --json starts.json

Each run draws one of the recordings, a moment, whole images or a random part of at least half their
width and height, full or half size, and all or every second frame. A runaway is a run in which an
estimate called `tracking` or `still` is more than 0.1 m off, an unreported one a run in which more
than 1 % of these are beyond three sigmas and 30 mm (see `reported_errors`).
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import click
import numpy as np

from benchmark_recordings import Case, cases
from recorded_runs import Run, cell, run_from
from reported_errors import UNREPORTED_SHARE
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.calibration import read_calibration
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.evaluation.ground_truth import read_ground_truth

# Of a run, s, and how far off one that is called reliable may be, mm.
_LENGTH, _RUNAWAY = 8.0, 100.0


def drawn(sources: Sequence[Case], ends: Sequence[float], runs: int, seed: int) -> list[Case]:
    """Runs at random.

    Args:
        sources: whole recordings.
        ends: their lengths, s.
        runs: how many.
        seed: of all randomness.
    """
    rng = np.random.default_rng(seed)
    chosen = []
    for _ in range(runs):
        i = int(rng.integers(len(sources)))
        recorded = sources[i].recorded
        begin = round(float(rng.uniform(0.0, ends[i] - _LENGTH)), 2)
        topic = recorded.image_topic
        camera = read_calibration(
            Path(recorded.calibration),
            image_topic=topic.removesuffix("/compressed") if topic else None,
        ).camera
        crop = None
        if rng.random() < 0.5:
            full = np.array([camera.width, camera.height])
            size = rng.integers(full // 2, full + 1)
            left, top = rng.integers(0, full - size + 1).tolist()
            crop = left, top, int(size[0]), int(size[1])
        shrink, every = (int(rng.choice([1, 1, 2])) for _ in range(2))
        part = f"{crop[2]}x{crop[3]} at {crop[0]},{crop[1]}" if crop else "whole images"
        name = f"{sources[i].name}, {part}, 1/{shrink} size, 1/{every} of the frames"
        changed = replace(recorded, crop=crop, shrink=shrink, every=every)
        chosen.append(Case(name, changed, begin, _LENGTH))
    return chosen


def report(rows: Sequence[tuple[str, Run]]) -> str:
    """What the runs come to together, and the runaways."""
    found = [run for _, run in rows if run.ate is not None]
    live = np.array([run.ate for run in found])
    delays = np.array([np.inf if run.delay is None else run.delay for _, run in rows])
    beyond = [run.beyond for run in found if run.beyond is not None]
    unreported = sum((run.unreported or 0.0) > UNREPORTED_SHARE for run in found)
    runaways = [(name, run) for name, run in rows if (run.worst_reliable or 0.0) > _RUNAWAY]
    lines = [
        f"{len(rows)} runs, {len(found)} with a trajectory: "
        f"live ATE median {np.median(live):.1f} mm, 90 % up to {np.quantile(live, 0.9):.1f}, "
        f"worst {live.max():.1f}; frames {100 * np.mean([run.frames for _, run in rows]):.0f} %; "
        f"first pose after {np.median(delays):.2f} s (median); {len(runaways)} runaways; "
        f"{unreported} of {len(beyond)} unreported; frames beyond three sigmas "
        f"{cell(100 * float(np.mean(beyond)) if beyond else None, 1)} %",
    ]
    lines += [
        f"- {name}, from {run.begin:g} s: {cell(run.worst_reliable, 0)} mm off while reliable"
        for name, run in runaways
    ]
    return "\n".join([*lines, "", *_by_recording(rows)])


def _by_recording(rows: Sequence[tuple[str, Run]]) -> list[str]:
    """A table; NIS and NEES are the medians over the runs."""
    titles = "runs | none | frames, % | live ATE, median, mm | 90 % up to | worst | NIS | NEES"
    lines = [f"| recording | {titles} |", "|---|" + "---:|" * 8]
    names = [name.split(",")[0] for name, _ in rows]
    for recording in dict.fromkeys(names):
        runs = [run for name, (_, run) in zip(names, rows, strict=True) if name == recording]
        live = [run.ate for run in runs if run.ate is not None] or [np.nan]
        frames = 100 * np.mean([run.frames for run in runs])
        of_ate = f"{np.median(live):.1f} | {np.quantile(live, 0.9):.1f} | {max(live):.0f}"
        nis = _median([run.nis for run in runs])
        nees = _median([run.nees for run in runs])
        none = sum(run.ate is None for run in runs)
        lines.append(
            f"| {recording} | {len(runs)} | {none} | {frames:.0f} | {of_ate} | {nis} | {nees} |"
        )
    return lines


def _median(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return cell(float(np.median(known)) if known else None, 2)


def _length(truth: str) -> float:
    stamps = read_ground_truth(truth).stamps
    return float(stamps[-1] - stamps[0]) * 1e-9


def _run(case: Case) -> Run:
    return run_from(case.recorded, case.duration, case.begin)


@click.command(help=__doc__.replace("\n\n    ", "\n\n\b\n    ") if __doc__ else None)
@click.option("--data", type=click.Path(exists=True, path_type=Path), required=True)
@click.option("--cache", type=click.Path(path_type=Path), default=Path("results/flights"))
@click.option("--runs", default=200, show_default=True)
@click.option("--seed", default=0, show_default=True)
@click.option("--jobs", default=1, show_default=True, help="Runs at a time.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write all runs here.")
def main(data: Path, cache: Path, runs: int, seed: int, jobs: int, json_file: Path | None) -> None:
    """Command line."""
    whole = [
        case
        for case in cases(data, cache)
        if case.duration is None
        and case.recorded == replace(case.recorded, crop=None, shrink=1, every=1)
    ]
    try:
        ends = [_length(case.recorded.truth) for case in whole]
        rows = []
        for case, run in in_parallel(_run, drawn(whole, ends, runs, seed), workers=jobs):
            rows.append((case.name, run))
            error = f"{cell(run.ate, 1)} mm, {cell(run.worst_reliable, 0)} at most"
            click.echo(f"{case.name}, from {run.begin:g} s: {error}", err=True)
    except RuledgraphError as error:
        click.echo(f"random_starts: {error}", err=True)
        sys.exit(2)
    print(report(rows))
    if json_file is not None:
        found = [{"name": name, **asdict(run)} for name, run in rows]
        json_file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
