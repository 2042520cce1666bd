# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory and line map from the top, the front and the side, all to one scale."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ruledgraph.calibration.sensors import FloatArray
from ruledgraph.core import figure_style as style
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import EvaluationError, alignment, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.run_tables import RunTables

# Lines whose worse end is known worse than this are left out, m.
_LINE_SIGMA = 0.2
# Most of the lines are in view, but the path fills at least this share of it.
_LINES_IN_VIEW, _PATH_SHARE = 0.9, 0.12
_MARGIN = 0.08
# A view is at least this wide, as a share of the widest one.
_NARROWEST = 0.3
# Of the drawing, inches: the widest and tallest it may get, the gap between views, the margins.
_WIDTH, _HEIGHT = 11.0, 9.4
_GAP, _LEFT, _BOTTOM, _TOP, _RIGHT = 0.65, 0.7, 0.55, 1.05, 0.25
# The path is enlarged where it takes less than this of the views.
_SMALL = 0.6
_MOST_PIECES = 4000


@dataclass(frozen=True, eq=False)
class _Path:
    """What is drawn of a run."""

    smoothed: FloatArray
    live: FloatArray
    truth: FloatArray | None
    values: FloatArray
    """That the colours show, of each smoothed pose."""
    label: str
    breaks: NDArray[np.bool_]
    """Whether the path is interrupted after a pose."""


def trajectory_figure(run: RunTables, truth: GroundTruth | None) -> Figure:
    """Draw the smoothed path, coloured by error (without ground truth by time), and the lines.

    Ground truth is aligned to the estimate by a rigid motion. Views share their axes: the front
    lies below the top view, the side to its right, as in an engineering drawing. In the corner
    that is left the path is enlarged, without the lines.
    """
    path = _path(run, truth)
    ends = run.lines.ends[run.lines.sigmas < _LINE_SIGMA]
    low, high = view_box(path.smoothed, ends)
    size = high - low
    # Inches a metre.
    scale = min(
        (_WIDTH - _LEFT - _RIGHT - _GAP) / (size[0] + size[2]),
        (_HEIGHT - _BOTTOM - _TOP - _GAP) / (size[1] + size[2]),
    )
    wide, deep, tall = scale * size
    width, height = _LEFT + wide + _GAP + tall + _RIGHT, _BOTTOM + tall + _GAP + deep + _TOP
    upper, right = _BOTTOM + tall + _GAP, _LEFT + wide + _GAP
    with style.figure_style():
        figure = Figure(figsize=(width, height))

        def axes(left: float, bottom: float, across: float, up: float, **kind: Any) -> Any:
            where = (left / width, bottom / height, across / width, up / height)
            return figure.add_axes(where, **kind)

        for view, a, b, name in (
            (axes(_LEFT, upper, wide, deep), 0, 1, "top"),
            (axes(right, upper, tall, deep), 2, 1, "side"),
            (axes(_LEFT, _BOTTOM, wide, tall), 0, 2, "front"),
        ):
            drawn = _draw_view(view, path, ends, a, b)
            view.set(xlim=(low[a], high[a]), ylim=(low[b], high[b]), title=name)
            view.set(xlabel=f"{'xyz'[a]} (m)", ylabel=f"{'xyz'[b]} (m)", aspect="equal")
            view.locator_params(nbins=6)
        handles, labels = view.get_legend_handles_labels()
        # A legend shows one colour of a path that has many.
        handles[labels.index("smoothed")] = Line2D([], [], color=drawn.cmap(0.35), lw=2.0)
        extent = np.ptp(path.smoothed, axis=0)
        if float((extent / size).max()) < _SMALL:
            a, b = sorted(np.argsort(extent)[1:])
            close = axes(right, _BOTTOM, tall, tall)
            _draw_view(close, path, ends[:0], a, b)
            close.set_aspect("equal", adjustable="datalim")
            close.set_title(f"path, enlarged: {'xyz'[a]} and {'xyz'[b]} (m)")
            close.locator_params(nbins=6)
        figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.02, 0.995), ncols=6)
        bar = axes(width - 2.75, height - 0.34, 2.4, 0.13)
        figure.colorbar(drawn, cax=bar, orientation="horizontal")
        bar.text(-0.04, 0.5, path.label, transform=bar.transAxes, ha="right", va="center")
    return figure


def view_box(path: FloatArray, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners of a box with all of the path (N, 3) and most ends of lines (L, 2, 3), but not so
    many that the path gets too small to be seen.
    """
    low, high = path.min(axis=0), path.max(axis=0)
    longest = max(float((high - low).max()), 0.1)
    if len(ends):
        beyond = 0.5 * longest * (1.0 / _PATH_SHARE - 1.0)
        tail = 0.5 * (1.0 - _LINES_IN_VIEW)
        reach = np.quantile(ends.reshape(-1, 3), [tail, 1.0 - tail], axis=0)
        low = np.minimum(low, np.maximum(reach[0], low - beyond))
        high = np.maximum(high, np.minimum(reach[1], high + beyond))
    low, high = low - _MARGIN * longest, high + _MARGIN * longest
    lacking = np.maximum(_NARROWEST * (high - low).max() - (high - low), 0.0)
    return low - 0.5 * lacking, high + 0.5 * lacking


def aligned_truth(estimate: Trajectory, truth: GroundTruth) -> tuple[Trajectory, FloatArray]:
    """The estimate's poses that ground truth covers, and the truth at their stamps, (N, 3), moved
    onto them by the rigid motion that fits best.

    Raises:
        EvaluationError: when they hardly overlap.
    """
    kept, known = matched(estimate, truth)
    A = alignment(known.positions, kept.positions)
    return kept, known.positions @ A[:3, :3].T + A[:3, 3]


def _path(run: RunTables, truth: GroundTruth | None) -> _Path:
    shown, true_positions = run.smoothed, None
    if truth is not None:
        with suppress(EvaluationError):  # the report says so
            shown, true_positions = aligned_truth(run.smoothed, truth)
    seconds = run.since_start(shown)
    steps = np.diff(seconds)
    breaks = steps > 5.0 * np.median(steps) if len(steps) else np.zeros(0, dtype=bool)
    if true_positions is None:
        return _Path(shown.positions, run.live.positions, None, seconds, "time (s)", breaks)
    error = 1e3 * np.linalg.norm(shown.positions - true_positions, axis=1)
    label = "position error (mm)"
    return _Path(shown.positions, run.live.positions, true_positions, error, label, breaks)


def _draw_view(axes: Any, path: _Path, ends: FloatArray, a: int, b: int) -> LineCollection:
    pair = [a, b]
    lines = LineCollection(list(ends[:, :, pair]), colors=style.LINES, linewidths=1.0)
    lines.set_label("line map")
    axes.add_collection(lines)
    if path.truth is not None:
        axes.plot(*path.truth[:, pair].T, color=style.TRUTH, lw=3.2, alpha=0.25, label="truth")
    axes.plot(*path.live[:, pair].T, color=style.LIVE, lw=1.0, label="live")
    step = max(1, len(path.smoothed) // _MOST_PIECES)
    points = path.smoothed[::step, pair]
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    broken = np.flatnonzero(path.breaks) // step
    whole = ~np.isin(np.arange(len(pieces)), broken)
    colored = LineCollection(list(pieces[whole]), cmap=style.SEQUENTIAL, linewidths=2.0)
    colored.set_array(path.values[::step][:-1][whole])
    colored.set_clim(0.0 if path.truth is not None else None, None)
    colored.set_label("smoothed")
    axes.add_collection(colored)
    for position, marker, color, name in (
        (path.smoothed[0], "o", style.START, "start"),
        (path.smoothed[-1], "s", style.END, "end"),
    ):
        axes.plot(
            *position[pair], marker, color=color, ms=8, mec="white", mew=1.4, label=name, zorder=5
        )
    return colored
