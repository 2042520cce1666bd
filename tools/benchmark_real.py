# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy on 30 s of EuRoC MH_01_easy, beside what point-based systems published for them.

    python tools/benchmark_real.py --data DATA --keep results/mh01 --json mh01.json
    python tools/benchmark_real.py --data DATA --run results/mh01

All trajectories go through the same evaluation: ground truth interpolated at their stamps, ATE and
RPE by evo, SE(3)-aligned without scale, for the whole 30 s and for the first 16 s, in which the
camera moves; once over the time that all of them cover, once over whatever each of them covers. The
point-based systems had run for 5 s when the recording begins, ours starts with it.
"""

import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from benchmark_accuracy import REAL_MOVING, REAL_SLICE, real_recording
from ruledgraph.app.run_input import RunInput
from ruledgraph.app.runner import run
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame
from ruledgraph.core.trajectory import Trajectory, read_tum
from ruledgraph.evaluation import EvaluationError, compare, matched
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth

OURS = {"ruledgraph, live": "trajectory_live.tum", "ruledgraph, smoothed": "trajectory.tum"}
PEERS = {"points, mono": "vio_mono.tum", "points, stereo": "vio_stereo.tum"}
# The recording's length, s.
_WHOLE = 30.0
# RPE is taken over this length of path, m.
_LENGTH = 1.0


@dataclass(frozen=True)
class Figures:
    """Of one trajectory over one stretch; m and degrees."""

    estimate: str
    stretch: str
    """Which part of the recording."""
    over: str
    """`common`, the time that all estimates cover, or `own`."""
    begin: float
    """First pose that was compared, s after the recording's first frame."""
    end: float
    poses: int
    path_length: float
    ate_rmse: float
    ate_max: float
    ate_rotation_rmse: float
    rpe_rmse: float | None
    """Over 1 m of path; None where the path is too short."""
    rpe_rotation_rmse: float | None


def figures(estimates: Mapping[str, Trajectory], truth: GroundTruth, start: int) -> list[Figures]:
    """All figures of a recording that begins at `start`, ns."""
    stretches = {
        f"whole {_WHOLE:g} s": start + round(_WHOLE * 1e9),
        f"moving {REAL_MOVING:g} s": start + round(REAL_MOVING * 1e9),
    }
    # Half a millisecond: published stamps are rounded.
    slack = 500_000
    first = max(trajectory.stamps[0] for trajectory in estimates.values())
    last = min(trajectory.stamps[-1] for trajectory in estimates.values())
    rows = []
    for stretch, end in stretches.items():
        for over, begin, finish in (("common", first, min(last, end)), ("own", start, end)):
            for name, whole in estimates.items():
                part = _between(whole, begin - slack, finish + slack)
                rows.append(_figures(part, truth, (name, stretch, over), start))
    return rows


def _figures(
    part: Trajectory, truth: GroundTruth, labels: tuple[str, str, str], start: int
) -> Figures:
    kept, known = matched(part, truth)
    found = compare(kept, known, lengths=(_LENGTH,))
    rpe = found.errors.get(f"rpe_translation_{_LENGTH:g}m")
    turn = found.errors.get(f"rpe_rotation_{_LENGTH:g}m")
    return Figures(
        *labels,
        begin=_seconds(kept.stamps[0] - start),
        end=_seconds(kept.stamps[-1] - start),
        poses=len(kept),
        path_length=found.association.path_length,
        ate_rmse=found.errors["ate_translation"].rmse,
        ate_max=found.errors["ate_translation"].max,
        ate_rotation_rmse=found.errors["ate_rotation"].rmse,
        rpe_rmse=rpe.rmse if rpe else None,
        rpe_rotation_rmse=turn.rmse if turn else None,
    )


def _seconds(span: int) -> float:
    """To the millisecond, without a negative zero."""
    return round(float(span) * 1e-9, 3) + 0.0


def _between(whole: Trajectory, begin: int, end: int) -> Trajectory:
    inside = (whole.stamps >= begin) & (whole.stamps <= end)
    if not inside.any():
        raise EvaluationError("an estimate has no pose in the time that is compared")
    return Trajectory(whole.stamps[inside], whole.positions[inside], whole.quaternions[inside])


def report(rows: list[Figures]) -> str:
    """Markdown, a table for each stretch."""
    header = (
        "estimate",
        "time (s)",
        "poses",
        "path (m)",
        "ATE RMSE (mm)",
        "ATE max (mm)",
        "ATE rotation (deg)",
        "RPE over 1 m (mm)",
        "RPE rotation (deg)",
    )
    lines: list[str] = []
    for stretch, over in dict.fromkeys((row.stretch, row.over) for row in rows):
        covered = "over the time all cover" if over == "common" else "each over what it covers"
        lines += [f"{stretch}, {covered}:", "", _cells(header)]
        lines.append("|---|---|" + "---:|" * (len(header) - 2))
        for row in rows:
            if (row.stretch, row.over) == (stretch, over):
                lines.append(
                    _cells(
                        (
                            row.estimate,
                            f"{row.begin:.2f} to {row.end:.2f}",
                            str(row.poses),
                            f"{row.path_length:.2f}",
                            f"{1e3 * row.ate_rmse:.1f}",
                            f"{1e3 * row.ate_max:.1f}",
                            f"{row.ate_rotation_rmse:.2f}",
                            "-" if row.rpe_rmse is None else f"{1e3 * row.rpe_rmse:.1f}",
                            "-"
                            if row.rpe_rotation_rmse is None
                            else f"{row.rpe_rotation_rmse:.2f}",
                        )
                    )
                )
        lines.append("")
    return "\n".join(lines)


def _cells(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cells) + " |"


def smooth_real(bag: str, folder: Path) -> None:
    """Smooth the recording with default settings, results in `folder`."""
    stream, calibration, truth = real_recording(bag)
    run(RunInput(stream, calibration, truth), Config(), folder)


def _first_frame(bag: str) -> int:
    stream, _, _ = real_recording(bag, duration=1.0)
    for measurement in stream:
        if isinstance(measurement, Frame):
            return measurement.stamp
    raise EvaluationError(f"{bag}.bag: has no frame in its first second")


def evaluated(data: Path, folder: Path) -> list[Figures]:
    """The figures of a results folder and of the published trajectories."""
    bag = data / REAL_SLICE
    estimates = {name: read_tum(folder / file) for name, file in OURS.items()}
    for name, file in PEERS.items():
        estimates[name] = read_tum(bag.parent / "peers" / file)
    return figures(estimates, read_ground_truth(f"{bag}.gt.tum"), _first_frame(str(bag)))


@click.command(help=__doc__)
@click.option(
    "--data",
    type=click.Path(exists=True, path_type=Path),
    required=True,
    help=f"Folder with {REAL_SLICE.parent}.",
)
@click.option(
    "--run",
    "folder",
    type=click.Path(path_type=Path),
    help="Results of this recording: evaluate them, smooth nothing.",
)
@click.option("--keep", type=click.Path(path_type=Path), help="Folder for the new results.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write figures here.")
def main(data: Path, folder: Path | None, keep: Path | None, json_file: Path | None) -> None:
    """Command line."""
    if folder is not None and keep is not None:
        raise click.UsageError("--run smooths nothing that --keep could keep; leave one out")
    if json_file is not None and json_file.exists():
        raise click.UsageError(f"{json_file}: exists already, choose another name")
    try:
        with tempfile.TemporaryDirectory() as scratch:
            if folder is None:
                folder = keep or Path(scratch)
                print(f"smoothing {REAL_SLICE.name}: some minutes", file=sys.stderr, flush=True)
                smooth_real(str(data / REAL_SLICE), folder)
            rows = evaluated(data, folder)
    except RuledgraphError as error:
        click.echo(f"benchmark_real: {error}", err=True)
        sys.exit(2)
    print(report(rows))
    if json_file is not None:
        text = json.dumps([asdict(row) for row in rows], indent=2, allow_nan=False)
        json_file.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
