# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of a run: trajectory and lines, errors, image overlays, ruled surfaces."""

import csv
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ruledgraph.calibration.sensors import CameraModel, FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame
from ruledgraph.core.trajectory import Trajectory, read_tum
from ruledgraph.evaluation import EvaluationError, alignment, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.overlay import FrameQueue, line_color

# An overlay is kept this often, s, and so many at most: then every second one goes.
_OVERLAY_INTERVAL, _MOST_OVERLAYS = 1.0, 12
# Ruled surfaces are shown of so many lines over so long a stretch, s, from the first start.
_SURFACES, _SURFACE_LENGTH, _SURFACE_POINTS = 8, 2.0, 25
# Lines further away than this from the path's middle, or known worse, are left out, m.
_FURTHEST, _LINE_SIGMA = 15.0, 0.2
_COLORS = mpl.colormaps["tab20"]


class Sketches:
    """Collects what the pictures need while a run goes on, then draws them."""

    def __init__(self, camera: CameraModel) -> None:
        self._camera = camera
        self._overlays: dict[int, NDArray[np.uint8]] = {}
        self._interval = _OVERLAY_INTERVAL
        self._last_overlay = 0
        self._surfaces: dict[int, list[tuple[float, FloatArray]]] = defaultdict(list)
        self._first: int | None = None
        self._frames = FrameQueue()

    def watch(self, odometry: Odometry, frame: Frame) -> None:
        """See the state when a frame has been added."""
        processed = self._frames.take(odometry, frame)
        if odometry.window is None or not processed:
            return
        frame = processed[-1]
        self._first = frame.stamp if self._first is None else self._first
        tracks = [t for t in odometry.tracker.tracks if t.number in odometry.window.lines]
        if (frame.stamp - self._first) * 1e-9 <= _SURFACE_LENGTH:
            for track in tracks:
                if track.misses == 0 and track.sightings:
                    sighting = track.sightings[-1]
                    time = (sighting.stamp - self._first) * 1e-9
                    pixels = self._camera.distort(sighting.points).pixels
                    self._surfaces[track.number].append((time, pixels))
        if (frame.stamp - self._last_overlay) * 1e-9 >= self._interval:
            self._last_overlay = frame.stamp
            self._overlays[frame.stamp] = self._overlay(frame, odometry)
            if len(self._overlays) > _MOST_OVERLAYS:
                self._overlays = dict(list(self._overlays.items())[::2])
                self._interval *= 2.0

    def _overlay(self, frame: Frame, odometry: Odometry) -> NDArray[np.uint8]:
        image = cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)
        for track in odometry.tracker.tracks:
            known = odometry.window is not None and track.number in odometry.window.lines
            color = line_color(track.number)[::-1] if known else (160, 160, 160)
            along = np.linspace(0.0, 1.0, 20)[:, None]
            curve = self._camera.distort(
                track.ends[0] + along * (track.ends[1] - track.ends[0])
            ).pixels
            fixed_point = np.rint(16.0 * curve).astype(np.int32)
            cv2.polylines(image, [fixed_point], False, color, 1, cv2.LINE_AA, 4)
            if track.misses == 0 and track.sightings:
                for u, v in self._camera.distort(track.sightings[-1].points).pixels:
                    cv2.circle(image, (round(u), round(v)), 1, color, -1)
        return np.asarray(image, dtype=np.uint8)

    def draw(self, output: Path, truth: GroundTruth | None) -> None:
        """Write the PNGs into `output/plots`."""
        folder = output / "plots"
        folder.mkdir()
        for stamp, image in self._overlays.items():
            cv2.imwrite(str(folder / f"overlay_{stamp}.png"), image)
        if self._surfaces:
            _ruled_surfaces(self._surfaces).savefig(folder / "ruled_surfaces.png", dpi=120)
        try:
            figures = result_figures(output, truth)
        except RuledgraphError:  # without poses there is nothing to draw
            return
        for name, figure in figures.items():
            figure.savefig(folder / f"{name}.png", dpi=120)


def result_figures(output: Path, truth: GroundTruth | None) -> dict[str, Figure]:
    """What the files of a run show, without its recording: name -> figure.

    Raises:
        RuledgraphError: when there are no poses, or a table cannot be read.
    """
    trajectory = read_tum(output / "trajectory.tum")
    live = read_tum(output / "trajectory_live.tum")
    lines, states = _table(output / "lines.csv"), _table(output / "states.csv")
    try:
        return {
            "trajectory": _three_views(trajectory, lines, truth),
            "states": _states(states, live, truth),
            "directrices": _directrices(trajectory, lines),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise RuledgraphError(f"{output}: its tables are not those of a run: {error}") from None


def _table(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(encoding="ascii", newline="") as file:
            return list(csv.DictReader(file))
    except (OSError, ValueError, csv.Error) as error:
        raise RuledgraphError(f"{path}: cannot be read: {error}") from None


def error_figure(estimates: Mapping[str, Trajectory], truth: GroundTruth) -> Figure | None:
    """Distance from the truth over time, each estimate aligned; None when none overlaps it."""
    figure = Figure(figsize=(13, 4), layout="constrained")
    axes = figure.add_subplot()
    first = min((int(trajectory.stamps[0]) for trajectory in estimates.values()), default=0)
    for i, (name, trajectory) in enumerate(estimates.items()):
        try:
            kept, known = matched(trajectory, truth)
        except EvaluationError:
            continue
        A = alignment(kept.positions, known.positions)
        error = kept.positions @ A[:3, :3].T + A[:3, 3] - known.positions
        seconds = (kept.stamps - first) * 1e-9
        axes.plot(
            seconds, 1e3 * np.linalg.norm(error, axis=1), color=_COLORS(2 * i % 20), label=name
        )
    if not axes.lines:
        return None
    axes.set(xlabel="s", ylabel="mm", title="position error, SE(3)-aligned")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right")
    return figure


def _ends(lines: list[dict[str, str]]) -> FloatArray:
    numbers = [[float(line[f"{a}{end}"]) for end in (1, 2) for a in "xyz"] for line in lines]
    return np.array(numbers).reshape(-1, 2, 3)


def _sigmas(lines: list[dict[str, str]]) -> FloatArray:
    """Deviation of the worse end of each line, m."""
    diagonal = ("xx", "yy", "zz")
    variances = [
        [sum(float(line[f"covariance{end}_{c}"]) for c in diagonal) for end in (1, 2)]
        for line in lines
    ]
    return np.asarray(np.sqrt(np.array(variances).reshape(-1, 2).max(axis=1)))


def _three_views(
    trajectory: Trajectory, lines: list[dict[str, str]], truth: GroundTruth | None
) -> Figure:
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    true_positions = None
    if truth is not None:
        try:
            kept, known = matched(trajectory, truth)
        except EvaluationError:
            pass
        else:
            A = alignment(known.positions, kept.positions)
            true_positions = known.positions @ A[:3, :3].T + A[:3, 3]
    ends = _ends(lines)
    centre = trajectory.positions.mean(axis=0)
    near = np.linalg.norm(ends - centre, axis=2).max(axis=1) < _FURTHEST
    shown = ends[near & (_sigmas(lines) < _LINE_SIGMA)]
    radius = _radius(trajectory.positions - centre, shown.reshape(-1, 3) - centre)
    for i, (a, b, name) in enumerate(((0, 1, "top"), (0, 2, "side"), (1, 2, "front"))):
        axes = figure.add_subplot(1, 3, i + 1)
        for pair in shown:
            axes.plot(pair[:, a], pair[:, b], color="0.7", linewidth=0.8)
        if true_positions is not None:
            axes.plot(true_positions[:, a], true_positions[:, b], "k--", label="ground truth")
        path = trajectory.positions
        axes.plot(path[:, a], path[:, b], color="tab:blue", label="smoothed")
        axes.plot(*path[0, [a, b]], "o", color="tab:green", label="start")
        axes.set(xlabel=f"{'xyz'[a]} (m)", ylabel=f"{'xyz'[b]} (m)", title=f"from the {name}")
        axes.set_xlim(centre[a] - radius, centre[a] + radius)
        axes.set_ylim(centre[b] - radius, centre[b] + radius)
        axes.set_aspect("equal", adjustable="box")
        axes.grid(alpha=0.3)
    axes.legend(loc="upper right")
    return figure


def _radius(path: FloatArray, ends: FloatArray) -> float:
    """Half the width of a view with all of the path and most of the lines, not so many that the
    path gets too small to be seen.
    """
    reach = float(np.abs(path).max())
    most = float(np.quantile(np.linalg.norm(ends, axis=1), 0.8)) if len(ends) else 0.0
    return max(1.15 * reach, min(1.1 * most, 5.0 * reach), 0.05)


def _states(states: list[dict[str, str]], live: Trajectory, truth: GroundTruth | None) -> Figure:
    """Position errors with 3 sigma when there is ground truth, and velocity and biases."""
    figure = Figure(figsize=(13, 11), layout="constrained")

    def column(name: str) -> FloatArray:
        return np.array([float(row[name]) for row in states])

    seconds = column("stamp") - live.stamps[0] * 1e-9
    rows = 4 if truth is not None else 3
    kinds: list[tuple[str, str, float]] = [
        ("velocity", "m/s", 1.0),
        ("gyroscope_bias", "rad/s", 1.0),
        ("accelerometer_bias", "m/s^2", 1.0),
    ]
    for row, (kind, unit, scale) in enumerate(kinds):
        for i, axis in enumerate("xyz"):
            axes = figure.add_subplot(rows, 3, 3 * row + i + 1)
            value, sigma = column(f"{kind}_{axis}"), column(f"sigma_{kind}_{axis}")
            axes.fill_between(
                seconds, value - 3 * sigma, value + 3 * sigma, color="tab:blue", alpha=0.2
            )
            axes.plot(seconds, scale * value, color="tab:blue")
            axes.set(title=f"{kind.replace('_', ' ')} {axis}", ylabel=unit)
            axes.grid(alpha=0.3)
    if truth is not None:
        try:
            kept, known = matched(live, truth)
        except EvaluationError:
            return figure
        A = alignment(kept.positions, known.positions)
        error = kept.positions @ A[:3, :3].T + A[:3, 3] - known.positions
        time = (kept.stamps - live.stamps[0]) * 1e-9
        spread = np.sqrt(sum(column(f"sigma_position_{axis}") ** 2 for axis in "xyz"))
        for i, axis in enumerate("xyz"):
            axes = figure.add_subplot(rows, 3, 10 + i)
            axes.fill_between(seconds, -3 * spread, 3 * spread, color="tab:orange", alpha=0.2)
            axes.plot(time, error[:, i], color="tab:orange")
            limit = 1.2 * float(np.abs(error).max()) + 1e-6
            axes.set(title=f"position error {axis}, live, aligned", ylabel="m", xlabel="s")
            axes.set_ylim(-limit, limit)
            axes.grid(alpha=0.3)
    return figure


def _ruled_surfaces(surfaces: dict[int, list[tuple[float, FloatArray]]]) -> Figure:
    """Lines in image-time space: the paper's figure 2."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    longest = sorted(surfaces, key=lambda number: -len(surfaces[number]))[:_SURFACES]
    for i, number in enumerate(longest):
        for time, pixels in surfaces[number]:
            some = pixels[:: max(1, len(pixels) // _SURFACE_POINTS)]
            axes.plot(
                np.full(len(some), time), some[:, 0], -some[:, 1], color=_COLORS(i), linewidth=0.6
            )
    axes.set(xlabel="time (s)", ylabel="u (px)", zlabel="-v (px)", title="ruled surfaces")
    return figure


def _directrices(trajectory: Trajectory, lines: list[dict[str, str]]) -> Figure:
    """The point of each line next to the body, and its direction, with the body's first
    orientation: X0 and V0 of the paper, over time.
    """
    figure = Figure(figsize=(13, 7), layout="constrained")
    first_R_world = trajectory.poses()[0].rotation().matrix().T
    spans = [(float(line["first_seen"]), float(line["last_seen"])) for line in lines]
    order = np.argsort([first - last for first, last in spans])[:_SURFACES]
    ends = _ends(lines)
    seconds = trajectory.stamps * 1e-9
    grid = [[figure.add_subplot(2, 3, 3 * row + i + 1) for i in range(3)] for row in range(2)]
    for color, j in enumerate(order):
        inside = (seconds >= spans[j][0]) & (seconds <= spans[j][1])
        direction = ends[j, 1] - ends[j, 0]
        direction = direction / np.linalg.norm(direction)
        offset = ends[j, 0] - trajectory.positions[inside]
        foot = offset - np.outer(offset @ direction, direction)
        time = seconds[inside] - seconds[0]
        for i in range(3):
            grid[0][i].plot(time, (foot @ first_R_world.T)[:, i], color=_COLORS(color))
            ruling = np.full(len(time), (first_R_world @ direction)[i])
            grid[1][i].plot(time, ruling, color=_COLORS(color))
    for i, axis in enumerate("xyz"):
        grid[0][i].set(title=f"directrix {axis}", ylabel="m")
        grid[1][i].set(title=f"ruling direction {axis}", xlabel="s")
    return figure
