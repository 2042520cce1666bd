# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph evaluate`: reads both trajectories, compares them, and says what came of it."""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import gtsam

from ruledgraph.calibration import read_calibration
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import (
    Alignment,
    AxisDifferences,
    Comparison,
    EvaluationError,
    LineDistances,
    axis_differences,
    compare,
    line_distances,
)
from ruledgraph.evaluation.by_evo import DEFAULT_LENGTHS
from ruledgraph.evaluation.sources import read_line_ends, read_marker_points, read_poses

_COLUMNS = ("rmse", "mean", "median", "std", "min", "max")
# Less of the estimate's duration than this is compared: say so.
_LITTLE = 0.9


def evaluate_command(
    estimate: str,
    reference: str,
    *,
    live: bool,
    align: Alignment,
    tolerance: float,
    lengths: Sequence[float],
    calibration: Path | None,
    markers: str | None,
    as_json: bool,
    plots: Path | None,
    save: Path | None,
) -> None:
    """See `ruledgraph evaluate --help`."""
    poses, truth = read_poses(estimate, live), read_poses(reference)
    if poses.quaternions is None:
        raise EvaluationError(f"{estimate}: has positions alone; an estimate needs orientations")
    trajectory = Trajectory(poses.stamps, poses.positions, poses.quaternions)
    found = compare(
        trajectory, truth, align=align, tolerance=tolerance, lengths=lengths or DEFAULT_LENGTHS
    )
    axes = None
    if truth.quaternions is not None:
        mounting = read_calibration(calibration).body_T_cam if calibration else gtsam.Pose3()
        with suppress(EvaluationError):  # the reference is too sparse to be interpolated
            axes = axis_differences(trajectory, truth, mounting)
    lines = []
    if markers:
        ends = read_line_ends(Path(estimate))
        lines = line_distances(read_marker_points(markers), ends, found.reference_T_estimate)
    written = [*(found.save(save) if save else ()), *(found.plot(plots) if plots else ())]
    if as_json:
        click.echo(json.dumps(_document(found, axes, lines), indent=2, allow_nan=False))
        return
    _print(found, axes, lines)
    for path in written:
        click.echo(str(path))


def _document(
    found: Comparison, axes: AxisDifferences | None, lines: Sequence[LineDistances]
) -> dict[str, Any]:
    return {
        "alignment": found.alignment,
        "association": asdict(found.association),
        "reference_T_estimate": found.reference_T_estimate.tolist(),
        "errors": {name: asdict(errors) for name, errors in found.errors.items()},
        "axes_first_pose_aligned": axes
        and {"mean": axes.mean.tolist(), "std": axes.std.tolist(), "poses": axes.poses},
        "lines": [asdict(line) for line in lines],
        "notes": list(found.notes),
    }


def _print(found: Comparison, axes: AxisDifferences | None, lines: Sequence[LineDistances]) -> None:
    pairs = found.association
    click.echo(
        f"{pairs.pairs} of {pairs.estimated} poses compared, with {pairs.reference} of the "
        f"reference: stamps at most {1e3 * pairs.tolerance:g} ms apart (mean "
        f"{1e3 * pairs.mean_offset:.3f} ms, largest {1e3 * pairs.max_offset:.3f} ms), "
        f"{100 * pairs.overlap:.1f} % of the estimate's duration, {pairs.path_length:.3f} m of path"
    )
    if min(pairs.overlap, pairs.pairs / min(pairs.estimated, pairs.reference)) < _LITTLE:
        click.echo("warning: much of the estimate is not compared", err=True)
    click.echo(f"alignment: {found.alignment}")
    click.echo(f"{'':24}{'pairs':>7}" + "".join(f"{column:>11}" for column in _COLUMNS))
    for name, errors in found.errors.items():
        shown = "".join(f"{getattr(errors, column):>11.6f}" for column in _COLUMNS)
        click.echo(f"{_label(name)} ({errors.unit})".ljust(24) + f"{errors.count:>7}{shown}")
    if axes is not None:
        shown = ", ".join(
            f"{axis} {mean:.4f} ± {std:.4f}"
            for axis, mean, std in zip("XYZ", axes.mean, axes.std, strict=True)
        )
        click.echo(f"difference in the first frame, first poses aligned (m): {shown}")
    for line in lines:
        click.echo(
            f"{line.name}: {line.markers} markers {line.mean:.4f} ± {line.std:.4f} m from the "
            "nearest line"
        )
    for note in found.notes:
        click.echo(f"note: {note}")


def _label(name: str) -> str:
    kind, part, *length = name.split("_")
    return " ".join([kind.upper(), part, *length])
