# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""States over time: values and errors with three standard deviations, lines in view, status."""

from typing import Any

import gtsam
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ruledgraph.core import figure_style as style
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import EvaluationError, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.evaluation.matching import yaw_alignment
from ruledgraph.visualization.run_tables import RunTables, broken

# A band's widest times, those after a start, do not set the limits.
_SHOWN = 0.97
_HEADROOM = 1.12
_STATES = (
    ("velocity", "velocity", "world", "m/s", 1.0),
    ("gyroscope_bias", "gyroscope bias", "body", "mrad/s", 1e3),
    ("accelerometer_bias", "accelerometer bias", "body", "m/s²", 1.0),
)


def state_figure(run: RunTables) -> Figure:
    """Velocity in the world and IMU biases at each state when it was new, with 3 sigma."""
    gaps = run.missing()
    with style.figure_style():
        figure = style.new_figure(12.0, 7.2)
        grid = figure.subplots(3, 3, sharex=True)
        for row, (column, name, frame, unit, scale) in zip(grid, _STATES, strict=True):
            values = scale * run.vectors(column)
            sigmas = scale * run.vectors(f"sigma_{column}")
            for i, axes in enumerate(row):
                axes.set_title(f"{name} {'xyz'[i]}, {frame}")
                times, value, sigma = broken(run.times, gaps, values[:, i], sigmas[:, i])
                _band(axes, times, value, sigma, style.AXES[i])
                axes.plot(times, value, color=style.AXES[i])
            row[0].set_ylabel(unit)
            for axes, (low, high) in zip(row, _limits(values, sigmas), strict=True):
                axes.set_ylim(low, high)
        for axes in grid[-1]:
            axes.set_xlabel("time (s)")
        figure.legend(
            handles=[Patch(color=style.MUTED, alpha=0.3, label="3 standard deviations")],
            loc="outside upper right",
        )
    return figure


def consistency_figure(run: RunTables, truth: GroundTruth) -> Figure | None:
    """Live errors of position and rotation in body axes, each with its own reported 3 sigma.

    Position and yaw of the world, which nothing observes, are those of the truth at the first
    pose; without true orientations the yaw is that which fits all positions best.

    Returns:
        None where ground truth and states do not overlap.
    """
    try:
        at, error = live_errors(run, truth)
    except EvaluationError:
        return None
    kinds = [("position", "mm", 1e3, error[:, 3:])]
    if truth.quaternions is not None:
        kinds.append(("rotation", "deg", 180.0 / np.pi, error[:, :3]))
    gaps = run.missing()
    with style.figure_style():
        figure = style.new_figure(12.0, 0.9 + 2.4 * len(kinds))
        grid = figure.subplots(len(kinds), 3, sharex=True, sharey="row", squeeze=False)
        for row, (name, unit, scale, errors) in zip(grid, kinds, strict=True):
            sigmas = run.vectors(f"sigma_{name}")[at]
            for i, axes in enumerate(row):
                inside = float(np.mean(np.abs(errors[:, i]) <= 3.0 * sigmas[:, i]))
                axes.set_title(f"{name} error, body {'xyz'[i]}")
                share = f"{100 * inside:.0f} % within 3 sigma"
                axes.set_title(share, loc="right", fontweight="normal", fontsize=8.5)
                shown = scale * sigmas[:, i], scale * errors[:, i]
                times, sigma, value = broken(run.times[at], gaps, *shown)
                _band(axes, times, np.zeros(len(times)), sigma, style.AXES[i])
                axes.plot(times, value, color=style.AXES[i])
                axes.axhline(0.0, color=style.MUTED, lw=0.6)
            row[0].set_ylabel(unit)
            half = scale * max(float(np.abs(errors).max()), 3.0 * np.quantile(sigmas, _SHOWN))
            row[0].set_ylim(-_HEADROOM * half, _HEADROOM * half)
        for axes in grid[-1]:
            axes.set_xlabel("time (s)")
    return figure


def live_errors(run: RunTables, truth: GroundTruth) -> tuple[NDArray[np.int64], FloatArray]:
    """Indices of the states that have ground truth, (K,), and Log(estimate^-1 truth), (K, 6).

    Rotation comes first, as in GTSAM; both are in body axes, as the reported covariance is.

    Raises:
        EvaluationError: when fewer than three states have ground truth.
    """
    index, states = _states(run)
    kept, known = matched(states, truth)
    poses = kept.poses()
    if known.quaternions is None:
        world_T_truth = gtsam.Pose3(yaw_alignment(known.positions, kept.positions))
        true_poses = [
            gtsam.Pose3(pose.rotation(), world_T_truth.transformFrom(position))
            for pose, position in zip(poses, known.positions, strict=True)
        ]
    else:
        true_poses = known.trajectory.poses()
        R = poses[0].rotation().matrix() @ true_poses[0].rotation().matrix().T
        yaw = gtsam.Rot3.Yaw(float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])))
        shift = poses[0].translation() - yaw.rotate(true_poses[0].translation())
        true_poses = [gtsam.Pose3(yaw, shift).compose(true) for true in true_poses]
    errors = [
        gtsam.Pose3.Logmap(pose.between(true)) for pose, true in zip(poses, true_poses, strict=True)
    ]
    return index[np.isin(states.stamps, kept.stamps)], np.array(errors)


def _states(run: RunTables) -> tuple[NDArray[np.int64], Trajectory]:
    """Indices of the states that have a live pose, and these poses."""
    live = run.live
    # float64 seconds of today are exact to some tenths of a microsecond.
    stamps = np.rint(1e9 * run.states.get("stamp", np.zeros(0))).astype(np.int64)
    nearest = np.clip(np.searchsorted(live.stamps, stamps - 1000), 0, len(live) - 1)
    index = np.flatnonzero(np.abs(live.stamps[nearest] - stamps) <= 1000)
    if not len(index):
        raise EvaluationError("the states have no poses")
    at = nearest[index]
    return index, Trajectory(live.stamps[at], live.positions[at], live.quaternions[at])


def status_figure(run: RunTables) -> Figure:
    """Lines in view, standard deviation of the position, and the status, over time."""
    with style.figure_style():
        figure = style.new_figure(12.0, 4.4)
        lines, sigma, strip = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 1))
        gaps = run.missing()
        counts = run.states.get("lines", np.zeros(0))
        times, counts = broken(run.times, gaps, counts, hold=True)
        lines.fill_between(times, counts, step="post", color=style.SMOOTHED, alpha=0.25, lw=0)
        lines.step(times, counts, where="post", color=style.SMOOTHED)
        lines.set_title("lines in view")
        lines.set_ylim(bottom=0.0)
        if len(run.times):
            total = 1e3 * np.linalg.norm(run.vectors("sigma_position"), axis=1)
            sigma.plot(*broken(run.times, gaps, total), color=style.SMOOTHED)
        sigma.set_title("standard deviation of the live position (mm)")
        sigma.set_ylim(bottom=0.0)
        draw_status(strip, run)
        strip.set_xlabel("time (s)")
    return figure


def draw_status(axes: Any, run: RunTables) -> None:
    """The status as a strip of colours; frames without an estimate are hatched."""
    pieces = status_pieces(run)
    for start, stop, status in pieces:
        missing = status == "without estimate"
        axes.axvspan(
            start,
            stop,
            facecolor=style.MISSING if missing else style.status_color(status),
            edgecolor=style.END if missing else "none",
            hatch="////" if missing else None,
            lw=0,
        )
    end = (run.span[1] - run.span[0]) * 1e-9
    axes.set(xlim=(0.0, max(end, 1e-3)), yticks=[], title="status")
    axes.grid(visible=False)
    handles = [
        Patch(
            facecolor=style.MISSING if name == "without estimate" else style.status_color(name),
            label=name,
        )
        for name in dict.fromkeys(status for _, _, status in pieces)
    ]
    axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))


def status_pieces(run: RunTables) -> list[tuple[float, float, str]]:
    """Times from, to, s since the first frame, and the status between, or `without estimate`."""
    # A state's status is that of the frames up to it.
    start, end = ((int(run.live.stamps[i]) - run.span[0]) * 1e-9 for i in (0, -1))
    pieces: list[tuple[float, float, str]] = []
    for time, status in zip(run.times.tolist(), run.statuses, strict=True):
        if pieces and pieces[-1][2] == status:
            start = pieces.pop()[0]
        if time > start:
            pieces.append((start, time, status))
            start = time
    if pieces:
        pieces[-1] = (pieces[-1][0], max(end, pieces[-1][1]), pieces[-1][2])
    return pieces + [(*piece, "without estimate") for piece in run.missing()]


def _limits(values: FloatArray, sigmas: FloatArray) -> list[tuple[float, float]]:
    """Of the panels of a row, each about its own values, all of the same height."""
    if not len(values):
        return [(-1.0, 1.0)] * 3
    low = np.minimum(values.min(axis=0), np.quantile(values - 3.0 * sigmas, 1.0 - _SHOWN, axis=0))
    high = np.maximum(values.max(axis=0), np.quantile(values + 3.0 * sigmas, _SHOWN, axis=0))
    middle, half = 0.5 * (low + high), 0.5 * _HEADROOM * float((high - low).max()) + 1e-9
    return [(float(each) - half, float(each) + half) for each in middle]


def _band(axes: Any, times: FloatArray, middle: FloatArray, sigma: FloatArray, color: str) -> None:
    low, high = middle - 3.0 * sigma, middle + 3.0 * sigma
    axes.fill_between(times, low, high, color=color, alpha=0.16, lw=0)
    for side in (low, high):
        axes.plot(times, side, color=color, lw=0.7, alpha=0.55)
