# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The paper's ruled surfaces: lines in image and time, and their directrices."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core import figure_style as style
from ruledgraph.core.arrays import FloatArray
from ruledgraph.visualization.run_tables import RunTables

_MAX_LINES = 8
# Of the longest time that a line was seen.
_LONG = 0.6
_CAPTION = (
    "Each colour is one line of the scene. Its edge points, stacked over time, form a ruled "
    "surface:\na straight ruling in every frame, bent by the camera's motion alone. The shape of "
    "these surfaces,\nwith the IMU, is what the motion is estimated from."
)


def ruled_surface_figure(
    surfaces: Mapping[int, Sequence[tuple[float, FloatArray]]], camera: CameraModel
) -> Figure:
    """Draw some lines that were seen long, in different parts of the image.

    Args:
        surfaces: number of a line -> time, s, and its ruling's ends, px, (2, 2), in each frame.
        camera: whose image they are in.
    """
    chosen = _spread(surfaces)
    with style.figure_style():
        figure = Figure(figsize=(9.5, 6.6))
        axes: Any = figure.add_axes((-0.08, 0.13, 1.14, 0.92), projection="3d")
        for number in chosen:
            times = np.array([time for time, _ in surfaces[number]])
            ends = np.array([ends for _, ends in surfaces[number]])
            # Time, u and v of both ends of each ruling.
            t = np.repeat(times[:, None], 2, axis=1)
            points = np.stack([t, ends[:, :, 0], ends[:, :, 1]], axis=2)
            color = np.array(style.line_color(number)) / 255.0
            # Not clipped: to matplotlib the box's own rectangle is narrower than the box.
            rulings = Line3DCollection(list(points), colors=[(*color, 0.55)], linewidths=0.9)
            axes.add_collection3d(rulings).set_clip_on(False)
            for side in (0, 1):
                axes.plot(*points[:, side].T, color=0.8 * color, lw=1.2, clip_on=False)
            axes.text(*points[-1].mean(axis=0), f" {number}", color=0.7 * color, fontsize=8)
        stop = max((time for number in chosen for time, _ in surfaces[number]), default=1.0)
        axes.set(xlim=(0.0, stop), ylim=(0, camera.width), zlim=(camera.height, 0))
        axes.set(xlabel="time (s)", ylabel="u (px)", zlabel="v (px)")
        axes.set_box_aspect((2.0, camera.width / camera.height, 1.0), zoom=1.28)
        axes.view_init(elev=20.0, azim=-58.0)
        figure.text(0.05, 0.95, "Ruled surfaces", fontsize=13, fontweight="bold")
        figure.text(0.05, 0.025, _CAPTION, color=style.MUTED, fontsize=9, linespacing=1.4)
    return figure


def _spread(surfaces: Mapping[int, Sequence[tuple[float, FloatArray]]]) -> list[int]:
    """Of the lines seen for most of the time, those that lie farthest from each other."""
    most = max(map(len, surfaces.values()), default=0)
    left = {
        number: np.mean([ends for _, ends in frames], axis=(0, 1))
        for number, frames in surfaces.items()
        if len(frames) >= _LONG * most
    }
    chosen = sorted(left, key=lambda number: -len(surfaces[number]))[:1]
    while len(chosen) < min(_MAX_LINES, len(left)):
        distances = {
            number: min(float(np.hypot(*(middle - left[other]))) for other in chosen)
            for number, middle in left.items()
        }
        chosen.append(max(distances, key=lambda number: distances[number]))
    return chosen


def directrix_figure(run: RunTables) -> Figure:
    """The point of each line closest to the body, and its direction, in the body's first
    orientation: X0 and V0 of the paper, over time.
    """
    first_R_world = run.smoothed.poses()[0].rotation().matrix().T
    order = np.argsort(run.lines.seen[:, 0] - run.lines.seen[:, 1])[:_MAX_LINES]
    seconds = run.smoothed.stamps * 1e-9
    with style.figure_style():
        figure = style.new_figure(12.0, 6.0)
        grid = figure.subplots(2, 3, sharex=True, sharey="row")
        for j in order:
            inside = (seconds >= run.lines.seen[j, 0]) & (seconds <= run.lines.seen[j, 1])
            ends = run.lines.ends[j]
            direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            offset = ends[0] - run.smoothed.positions[inside]
            closest = (offset - np.outer(offset @ direction, direction)) @ first_R_world.T
            times = run.since_start(run.smoothed)[inside]
            color = np.array(style.line_color(run.lines.numbers[j])) / 255.0
            for i in range(3):
                grid[0][i].plot(times, closest[:, i], color=color)
                ruling = np.full(len(times), (first_R_world @ direction)[i])
                grid[1][i].plot(times, ruling, color=color)
        for i, axis in enumerate("xyz"):
            grid[0][i].set_title(f"directrix {axis} (m)")
            grid[1][i].set(title=f"direction {axis}", xlabel="time (s)")
    return figure
