# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Several trajectories together, against ground truth."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ruledgraph.core import figure_style as style
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import Comparison, EvaluationError, alignment, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.three_views import ThreeViews
from ruledgraph.visualization.trajectory_figure import view_box


def error_figure(estimates: Mapping[str, Trajectory], truth: GroundTruth) -> Figure | None:
    """Distance from the truth over time, each estimate aligned; None when none overlaps it."""
    first = min((int(trajectory.stamps[0]) for trajectory in estimates.values()), default=0)
    with style.figure_style():
        figure = style.new_figure(12.0, 3.4)
        axes = figure.add_subplot()
        for i, (name, trajectory) in enumerate(estimates.items()):
            try:
                kept, known = matched(trajectory, truth)
            except EvaluationError:
                continue
            A = alignment(kept.positions, known.positions)
            error = kept.positions @ A[:3, :3].T + A[:3, 3] - known.positions
            axes.plot(
                (kept.stamps - first) * 1e-9,
                1e3 * np.linalg.norm(error, axis=1),
                color=style.SERIES[i % len(style.SERIES)],
                label=name,
            )
        if not axes.lines:
            return None
        axes.set(xlabel="time (s)", ylabel="mm", title="position error, SE(3)-aligned")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4)
    return figure


def evaluation_figures(found: Mapping[str, Comparison]) -> dict[str, Figure]:
    """What `compare` found of one or several estimates, by their names: name -> figure.

    `trajectories`: the aligned estimates and the reference; `ate`: errors over time; `rpe`:
    relative errors over each length of path, as boxes from quartile to quartile with whiskers from
    the 5th to the 95th percentile. What no comparison has is left out.
    """
    figures = {"trajectories": _trajectories(found)}
    for name, draw in (("ate", _ate), ("rpe", _rpe)):
        kinds = [kind for kind in _kinds(found) if kind.startswith(name)]
        if kinds:
            figures[name] = draw(found, kinds)
    return figures


def _kinds(found: Mapping[str, Comparison]) -> list[str]:
    return list(dict.fromkeys(kind for one in found.values() for kind in one.errors))


def _color(i: int) -> str:
    return style.SERIES[i % len(style.SERIES)]


def _trajectories(found: Mapping[str, Comparison]) -> Figure:
    paths = {name: one.aligned_positions() for name, one in found.items()}
    reference = max((one.reference_positions() for one in found.values()), key=len)
    low, high = view_box(np.concatenate([reference, *paths.values()]), np.empty((0, 2, 3)))
    with style.figure_style():
        drawing = ThreeViews(low, high)
        for axes, a, b in drawing.views:
            pair = [a, b]
            axes.plot(*reference[:, pair].T, color=style.TRUTH, lw=3.2, alpha=0.25)
            axes.lines[-1].set_label("reference")
            for i, (name, path) in enumerate(paths.items()):
                axes.plot(*path[:, pair].T, color=_color(i), label=name)
            axes.plot(*reference[0, pair], "o", color=style.START, ms=8, mec="white", label="start")
        drawing.legend(*axes.get_legend_handles_labels())
    return drawing.figure


def _ate(found: Mapping[str, Comparison], kinds: Sequence[str]) -> Figure:
    with style.figure_style():
        figure = style.new_figure(11.0, 0.8 + 2.3 * len(kinds))
        rows = figure.subplots(len(kinds), 1, sharex=True, squeeze=False)[:, 0]
        for axes, kind in zip(rows, kinds, strict=True):
            for i, (name, one) in enumerate(found.items()):
                if kind in one.errors:
                    scale, unit = _shown(one.errors[kind].unit)
                    label = f"{name}: RMSE {scale * one.errors[kind].rmse:.3g} {unit}"
                    axes.plot(
                        one.times(kind), scale * one.values(kind), color=_color(i), label=label
                    )
                    axes.set_ylabel(unit)
            axes.set_title(f"ATE, {kind.split('_')[1]}")
            axes.set_ylim(bottom=0.0)
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4)
        rows[-1].set_xlabel("time (s)")
    return figure


def _rpe(found: Mapping[str, Comparison], kinds: Sequence[str]) -> Figure:
    parts = list(dict.fromkeys(kind.split("_")[1] for kind in kinds))
    lengths = list(dict.fromkeys(kind.split("_")[2] for kind in kinds))
    width = 0.8 / len(found)
    with style.figure_style():
        figure = style.new_figure(11.0, 0.8 + 2.3 * len(parts))
        rows = figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
        for axes, part in zip(rows, parts, strict=True):
            for i, (name, one) in enumerate(found.items()):
                at, boxes = _boxes(one, part, lengths)
                if not boxes:
                    continue
                scale, unit = _shown(one.errors[f"rpe_{part}_{lengths[at[0]]}"].unit)
                axes.set_ylabel(unit)
                axes.boxplot(
                    [scale * values for values in boxes],
                    positions=[j + width * (i + 0.5) - 0.4 for j in at],
                    widths=0.8 * width,
                    whis=(5, 95),
                    showfliers=False,
                    patch_artist=True,
                    label=name,
                    boxprops={"facecolor": _color(i), "alpha": 0.45, "edgecolor": _color(i)},
                    medianprops={"color": style.INK},
                    whiskerprops={"color": _color(i)},
                    capprops={"color": _color(i)},
                )
            axes.set_title(f"RPE, {part}")
            axes.set_ylim(bottom=0.0)
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4)
        labels = [f"{length.removesuffix('m')} m" for length in lengths]
        rows[-1].set_xticks(range(len(lengths)), labels)
        rows[-1].set_xlabel("length of path")
    return figure


def _boxes(
    one: Comparison, part: str, lengths: Sequence[str]
) -> tuple[list[int], list[FloatArray]]:
    """The errors over those lengths that this comparison has, and which ones they are."""
    at = [j for j, length in enumerate(lengths) if f"rpe_{part}_{length}" in one.errors]
    return at, [one.values(f"rpe_{part}_{lengths[j]}") for j in at]


def _shown(unit: str) -> tuple[float, str]:
    return (1e3, "mm") if unit == "m" else (1.0, unit)
