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

from ruledgraph.core import figure_style as style
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import EvaluationError, alignment, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.run_tables import RunTables
from ruledgraph.visualization.three_views import ThreeViews

# Lines whose worse end is known worse than this are left out, m.
_LINE_SIGMA = 0.2
# Most of the lines are in view, but the path fills at least this share of it.
_LINES_IN_VIEW, _PATH_SHARE = 0.9, 0.06
_MARGIN = 0.08
# A view is at least this wide, as a share of the widest one.
_NARROWEST = 0.3
# The path is enlarged where it takes less than this of the views.
_SMALL = 0.6
_MAX_PIECES = 4000
# Of the path in the legend.
_LEGEND_COLORS = 6
# A step between poses this many times the usual one interrupts the path.
_BREAK = 5.0


@dataclass(frozen=True, eq=False)
class DrawnPath:
    """What is drawn of a run."""

    smoothed: FloatArray
    """Positions, m, (N, 3)."""
    times: FloatArray
    """Of the smoothed poses, s since the first frame, (N,)."""
    live: FloatArray
    """Positions, m, (M, 3)."""
    truth: FloatArray | None
    """At the smoothed poses, aligned to them, (N, 3)."""
    values: FloatArray
    """That the colours show, of each smoothed pose, (N,)."""
    label: str
    breaks: NDArray[np.bool_]
    """Whether the path is interrupted after a pose, (N - 1,)."""
    live_breaks: NDArray[np.bool_]
    """The same of the live one, (M - 1,)."""


def trajectory_figure(run: RunTables, truth: GroundTruth | None) -> Figure:
    """Draw the smoothed path, coloured by error (without ground truth by time), and the lines.

    Ground truth is aligned to the estimate by a rigid motion. Views share their axes: the front
    lies below the top view, the side to its right, as in an engineering drawing; z points up in
    both. In the corner that is left the path is enlarged, without the lines.
    """
    path = path_of(run, truth)
    ends = shown_lines(run)
    low, high = view_box(path.smoothed, ends)
    with style.figure_style():
        drawing = ThreeViews(low, high)
        for axes, a, b in drawing.views:
            colored = _draw_view(axes, path, ends, a, b)
        handles, labels = axes.get_legend_handles_labels()
        # A legend would show one colour of a path that has many.
        handles[labels.index("smoothed")] = tuple(
            Line2D([], [], color=colored.cmap(share), lw=2.0, solid_capstyle="butt")
            for share in np.linspace(0.0, 1.0, _LEGEND_COLORS)
        )
        drawing.legend(handles, labels)
        drawing.color_bar(colored, path.label)
        extent = np.ptp(path.smoothed, axis=0)
        if float((extent / (high - low)).max()) < _SMALL:
            a, b = sorted(np.argsort(extent)[1:].tolist())
            close = drawing.corner()
            _draw_view(close, path, ends[:0], a, b)
            close.margins(0.08)
            close.set_aspect("equal", adjustable="datalim")
            close.set(title="enlarged", xlabel=f"{'xyz'[a]} (m)", ylabel=f"{'xyz'[b]} (m)")
    return drawing.figure


def shown_lines(run: RunTables) -> FloatArray:
    """Ends of the lines that are known well, (L, 2, 3), m."""
    return run.lines.ends[run.lines.sigmas < _LINE_SIGMA]


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


def path_of(run: RunTables, truth: GroundTruth | None) -> DrawnPath:
    """The path of a run; where ground truth does not overlap it, as without one."""
    shown, true_positions = run.smoothed, None
    if truth is not None:
        with suppress(EvaluationError):  # the report says so
            shown, true_positions = aligned_truth(run.smoothed, truth)
    times = run.since_start(shown)
    values, label = times, "time (s)"
    if true_positions is not None:
        values = 1e3 * np.linalg.norm(shown.positions - true_positions, axis=1)
        label = "position error (mm)"
    return DrawnPath(
        shown.positions,
        times,
        run.live.positions,
        true_positions,
        values,
        label,
        _breaks(times),
        _breaks(run.since_start(run.live)),
    )


def _breaks(times: FloatArray) -> NDArray[np.bool_]:
    """After which poses, (N - 1,), at these times a path is interrupted."""
    steps = np.diff(times)
    return steps > _BREAK * np.median(steps) if len(steps) else np.zeros(0, dtype=np.bool_)


def _draw_view(axes: Any, path: DrawnPath, ends: FloatArray, a: int, b: int) -> LineCollection:
    pair = [a, b]
    lines = LineCollection(list(ends[:, :, pair]), colors=style.LINES, linewidths=1.0)
    lines.set_label("line map")
    axes.add_collection(lines)
    if path.truth is not None:
        truth = np.insert(path.truth, np.flatnonzero(path.breaks) + 1, np.nan, axis=0)
        axes.plot(*truth[:, pair].T, color=style.TRUTH, lw=3.2, alpha=0.25, label="truth")
    live = np.insert(path.live, np.flatnonzero(path.live_breaks) + 1, np.nan, axis=0)
    axes.plot(*live[:, pair].T, color=style.LIVE, lw=1.0, label="live")
    step = max(1, len(path.smoothed) // _MAX_PIECES)
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
