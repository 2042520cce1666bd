# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""All real recordings, whole, thinned out, made smaller, cropped, and begun at many moments.

    python tools/benchmark_recordings.py --data DATA --jobs 2 --json before.json
    python tools/benchmark_recordings.py --data DATA --only right --set window.lag=2

The flights are real motion and IMU with rendered views; they are rendered once, into --cache. Each
is a folder with groundtruth.csv and imu0.csv as EuRoC's, or NAME.npz with the same (gt: position,
quaternion w, x, y, z, velocity; imu: gyroscope, accelerometer; stamps gt_ns and imu_ns). A change
is judged by all rows together: chance moves single ones by half.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click
import numpy as np

from recorded_runs import Recorded, Run, cell, run_from
from reported_errors import TruthSigma
from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.app.cli import main as ruledgraph
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError

# Begun in the air, of MH_01: it moves for the first 16 s. Seconds.
_STARTS, _OF_A_START = np.arange(0.6, 15.0, 1.1).round(2).tolist(), 8.0
_FLIGHTS = (
    ("V1_01_easy", "room", 0.0),
    ("V1_02_medium", "room", 15.0),
    ("V1_03_difficult", "room", 15.0),
    ("MH_04_difficult", "hall", 15.0),
)
_OF_A_FLIGHT, _FLIGHT_RATE = 25.0, 20.0
# Of a packed flight: EuRoC's file, the name of its columns, and their titles.
_PACKED = (
    ("groundtruth", "gt", "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z,v_x,v_y,v_z"),
    ("imu0", "imu", "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z"),
)
# Of a reference by structure from motion, whose scale is from the IMU.
_MOTION_FROM_IMAGES = TruthSigma(position=0.005, scale=0.04)
# What a run without a pose, or a worse one, counts in the means, mm.
_FAILED = 100.0


@dataclass(frozen=True)
class Case:
    """A row of the table."""

    name: str
    recorded: Recorded
    begin: float = 0.0
    duration: float | None = None


def cases(data: Path, cache: Path) -> Iterator[Case]:
    """All of them; recordings that `data` lacks are left out."""
    left, right = data / "euroc_MH_01_30s", data / "euroc_MH_01_stereo_30s"
    if left.is_dir():
        own = _beside(left / "MH_01_30s")
        yield from _of_euroc("MH_01", own)
        yield Case("MH_01, every 2nd frame", replace(own, every=2))
        yield Case("MH_01, every 4th frame", replace(own, every=4))
        for name, crop in _crops():
            yield Case(f"MH_01, {name}", replace(own, crop=crop))
    if right.is_dir():
        both = _beside(right / "MH_01_stereo_30s")
        yield from _of_euroc("MH_01 right", replace(both, image_topic="/cam1/image_raw/compressed"))
    folder = data / "bedroom"
    if folder.is_dir():
        for name, calibration in (("owner's", "bedroom"), ("refined", "bedroom.refined")):
            files = "bedroom.bag", f"{calibration}.calib.yaml", "bedroom.ref.tum"
            bag, of_camera, truth = (str(folder / file) for file in files)
            recorded = Recorded(bag, of_camera, truth, truth_sigma=_MOTION_FROM_IMAGES)
            yield Case(f"bedroom, {name} calibration", recorded)
    for flight, scene, start in _FLIGHTS:
        source = data / "euroc_motion" / flight
        packed = source.with_suffix(".npz")
        if (source.is_dir() or packed.exists()) and left.is_dir():
            rendered = cache / f"{flight}.bag"
            if not rendered.exists():
                if not source.is_dir():
                    source = unpacked(packed, cache / flight)
                _render(rendered, source, scene, start, left / "MH_01_30s.calib.yaml")
            yield Case(f"{flight}, rendered {scene}", _beside(cache / flight))


def _of_euroc(name: str, recorded: Recorded) -> Iterator[Case]:
    yield Case(name, recorded)
    yield Case(f"{name}, half size", replace(recorded, shrink=2))
    for begin in _STARTS:
        yield Case(f"{name} from {begin:g} s", recorded, begin, _OF_A_START)


def _crops() -> Iterator[tuple[str, tuple[int, int, int, int]]]:
    yield "middle 480x480", (136, 0, 480, 480)
    yield "left half", (0, 0, 376, 480)
    yield "lower 640x360", (56, 120, 640, 360)


def _beside(path: Path) -> Recorded:
    """A recording with its calibration and truth next to it."""
    return Recorded(f"{path}.bag", f"{path}.calib.yaml", f"{path}.gt.tum")


def unpacked(packed: Path, folder: Path) -> Path:
    """The folder with a flight's states and IMU as EuRoC's files."""
    folder.mkdir(parents=True, exist_ok=True)
    with np.load(packed) as flight:
        for file, columns, titles in _PACKED:
            each = zip(flight[f"{columns}_ns"].tolist(), flight[columns].tolist(), strict=True)
            lines = [",".join(map(repr, (stamp, *row))) for stamp, row in each]
            text = "\n".join([titles, *lines, ""])
            (folder / f"{file}.csv").write_text(text, encoding="utf-8")
    return folder


def _render(bag: Path, source: Path, scene: str, start: float, calibration: Path) -> None:
    bag.parent.mkdir(parents=True, exist_ok=True)
    click.echo(f"rendering {bag}", err=True)
    files = ["--imu", source / "imu0.csv", "--calibration", calibration]
    span = ["--start", start, "--duration", _OF_A_FLIGHT, "--rate", _FLIGHT_RATE]
    arguments = ["simulate", scene, source / "groundtruth.csv", bag, *files, *span]
    ruledgraph([str(argument) for argument in arguments], standalone_mode=False)


def _run(case: Case) -> Run:
    return run_from(case.recorded, case.duration, case.begin)


def report(rows: Sequence[tuple[Case, Run]]) -> str:
    """Markdown: a table of whole recordings, one of starts, and what they come to together."""
    whole = [(case.name, run) for case, run in rows if case.duration is None]
    starts = [run for case, run in rows if case.duration is not None]
    titles = "recording | frames, % | degraded, % | first pose, s | live ATE, mm | worst, mm"
    lines = [f"| {titles} | live Sim(3), mm | scale | smoothed ATE, mm |", "|---|" + "---:|" * 8]
    for name, run in whole:
        figures = [
            f"{100 * run.frames:.0f}",
            f"{100 * run.degraded:.0f}",
            cell(run.delay, 2),
            cell(run.ate, 1),
            cell(run.worst, 1),
            cell(run.similar, 1),
            cell(run.scale, 3),
            cell(run.smoothed, 1),
        ]
        lines.append(f"| {name} | {' | '.join(figures)} |")
    for name, runs in (("whole", [run for _, run in whole]), ("starts", starts)):
        if runs:
            lines += ["", f"{len(runs)} {name}: {_together(runs)}"]
    return "\n".join(lines)


def _together(runs: Sequence[Run]) -> str:
    live = np.array([_counted(run.ate) for run in runs])
    smoothed = np.array([_counted(run.smoothed) for run in runs])
    delays = np.array([np.inf if run.delay is None else run.delay for run in runs])
    return (
        f"live ATE median {np.median(live):.1f} mm, geometric mean {_mean(live):.1f}, "
        f"{np.sum(live > 25.0)} over 25 mm, {np.sum(live >= _FAILED)} over {_FAILED:g} mm; "
        f"smoothed median {np.median(smoothed):.1f}, geometric mean {_mean(smoothed):.1f}; "
        f"frames {100 * np.mean([run.frames for run in runs]):.0f} %, degraded "
        f"{100 * np.mean([run.degraded for run in runs]):.0f} %; first pose after "
        f"{np.median(delays):.2f} s (median), {np.mean(delays <= 1.3):.0%} within 1.3 s"
    )


def _counted(ate: float | None) -> float:
    return _FAILED if ate is None else min(ate, _FAILED)


def _mean(values: FloatArray) -> float:
    return float(np.exp(np.mean(np.log(values))))


@click.command(help=__doc__.replace("\n\n    ", "\n\n\b\n    ") if __doc__ else None)
@click.option("--data", type=click.Path(exists=True, path_type=Path), required=True)
@click.option(
    "--cache",
    type=click.Path(path_type=Path),
    default=Path("results/flights"),
    show_default=True,
    help="Where rendered flights are kept.",
)
@click.option("--backwards", is_flag=True, help="Play all of them backwards.")
@click.option("--only", multiple=True, help="Cases whose name holds this; several: any of them.")
@click.option("--set", "settings", multiple=True, help="section.key=value, as of smooth.")
@click.option("--jobs", default=1, show_default=True, help="Runs at a time.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write all rows here.")
def main(
    data: Path,
    cache: Path,
    backwards: bool,
    only: tuple[str, ...],
    settings: tuple[str, ...],
    jobs: int,
    json_file: Path | None,
) -> None:
    """Command line."""
    chosen = [
        replace(case, recorded=replace(case.recorded, settings=settings, backwards=backwards))
        for case in cases(data, cache)
        if not only or any(word in case.name for word in only)
    ]
    try:
        runs = {}
        for case, run in in_parallel(_run, chosen, workers=jobs):
            runs[case.name] = run
            click.echo(
                f"{case.name}: {100 * run.frames:.0f} %, {cell(run.ate, 1)} mm live, "
                f"{cell(run.smoothed, 1)} mm smoothed, scale {cell(run.scale, 3)}",
                err=True,
            )
        rows = [(case, runs[case.name]) for case in chosen]
    except RuledgraphError as error:
        click.echo(f"benchmark_recordings: {error}", err=True)
        sys.exit(2)
    print(report(rows))
    if json_file is not None:
        found = {case.name: asdict(run) for case, run in rows}
        json_file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
