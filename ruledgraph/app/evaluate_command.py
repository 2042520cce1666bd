# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph evaluate`: reads both trajectories, compares them, and says what came of it."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import gtsam

from ruledgraph.calibration import read_calibration
from ruledgraph.core.new_folder import new_folder
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


@dataclass(frozen=True)
class _Evaluated:
    """What is said of one estimate."""

    found: Comparison
    axes: AxisDifferences | None
    lines: Sequence[LineDistances]


def evaluate_command(
    estimates: Sequence[str],
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
    truth = read_poses(reference)
    mounting = read_calibration(calibration).body_T_cam if calibration else gtsam.Pose3()
    several = len(estimates) > 1
    results = {}
    for name, estimate in zip(_names(estimates), estimates, strict=True):
        poses = read_poses(estimate, live)
        if poses.quaternions is None:
            raise EvaluationError(
                f"{estimate}: has positions alone; an estimate needs orientations"
            )
        trajectory = Trajectory(poses.stamps, poses.positions, poses.quaternions)
        found = compare(
            trajectory, truth, align=align, tolerance=tolerance, lengths=lengths or DEFAULT_LENGTHS
        )
        axes = None
        if truth.quaternions is not None:
            with suppress(EvaluationError):  # the reference is too sparse to be interpolated
                axes = axis_differences(trajectory, truth, mounting)
        lines: Sequence[LineDistances] = []
        if markers:
            ends = read_line_ends(Path(estimate))
            lines = line_distances(read_marker_points(markers), ends, found.reference_T_estimate)
        results[name] = _Evaluated(found, axes, lines)
    written = _draw(results, plots) if plots else []
    for name, result in results.items():
        if save:
            written += result.found.save(save / name if several else save)
    if as_json:
        documents = [_document(each.found, each.axes, each.lines) for each in results.values()]
        shown: Any = dict(zip(results, documents, strict=True)) if several else documents[0]
        click.echo(json.dumps(shown, indent=2, allow_nan=False))
        return
    for name, result in results.items():
        if several:
            click.echo(f"{name}:")
        _print(result.found, result.axes, result.lines)
        if several:
            click.echo()
    for path in written:
        click.echo(str(path))


def _names(estimates: Sequence[str]) -> list[str]:
    """Short names of files and folders that tell them apart."""
    short = [Path(estimate).stem or estimate for estimate in estimates]
    return [
        name if short.count(name) == 1 else f"{i} {name}" for i, name in enumerate(short, start=1)
    ]


def _draw(results: Mapping[str, _Evaluated], folder: Path) -> list[Path]:
    """All estimates together."""
    from ruledgraph.core.figure_style import save_figure
    from ruledgraph.visualization.comparison_figures import evaluation_figures

    paths = []
    with new_folder(folder):
        figures = evaluation_figures({name: each.found for name, each in results.items()})
        for name, figure in figures.items():
            paths.append(folder / f"{name}.png")
            save_figure(figure, paths[-1], 130)
    return paths


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
