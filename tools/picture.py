# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The README's picture: a simulated run, animated, as it is estimated.

    python tools/picture.py .github/ruledgraph.webp

On the left the camera's image with the rulings found in it, in the middle the lines in image and
time, which are the ruled surfaces, on the right the trajectory and the map of lines so far. All
that is drawn is what the odometry gave out at that time.
"""

import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from PIL import Image

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import LineEstimate
from ruledgraph.core.figure_style import line_color
from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry
from ruledgraph.simulation.options import simulation_from_options
from ruledgraph.visualization.overlay import draw_overlay
from ruledgraph.visualization.views import View, ViewQueue

SCENE, MOTION = "corridor", "walk"
GROUND, INK, FAINT = "#0f141c", "#e8edf5", "#3a4658"
WIDTH, HEIGHT = 1320, 430
# Images a second, of the recording and of the picture, and the time shown before the newest, s.
RATE, SHOWN_RATE, SURFACE = 60.0, 7, 1.5
# A line known worse than this is not drawn, m.
_LINE_SIGMA = 0.15
# Surfaces are drawn of lines seen for so long, s.
_LONG = 0.6


@dataclass
class State:
    """What is known at a moment."""

    view: View
    path: FloatArray
    lines: dict[int, FloatArray]
    """Number -> ends in the world, (2, 3)."""
    surfaces: dict[int, list[tuple[float, FloatArray]]]
    """Number -> time, s, and ends in the image, px, (2, 2)."""


def states(seconds: float, seed: int) -> tuple[list[State], CameraModel]:
    """Run the odometry and keep what it knows, a few times a second."""
    simulation = simulation_from_options(SCENE, MOTION, rate=RATE, duration=seconds, seed=seed)
    camera = simulation.calibration.camera
    odometry, queue = Odometry(simulation.calibration), ViewQueue()
    path: list[FloatArray] = []
    lines: dict[int, FloatArray] = {}
    surfaces: dict[int, list[tuple[float, FloatArray]]] = defaultdict(list)
    found: list[State] = []
    for measurement in simulation.stream():
        odometry.add(measurement)
        if not isinstance(measurement, Frame):
            continue
        path += [estimate.world_T_body.translation() for estimate in odometry.take_live()]
        odometry.take_smoothed()
        _note_lines(lines, odometry.take_lines())
        for view in queue.take(odometry, measurement):
            if odometry.window is None:
                continue
            outliers = odometry.config.lines.extent_outliers
            known = [line.estimate(outliers) for line in odometry.window.lines.values()]
            _note_lines(lines, [line for line in known if line is not None])
            for line in view.lines:
                if line.in_graph:
                    ends = camera.distort(line.points[[0, -1]]).pixels
                    surfaces[line.id].append((view.since_start, ends))
            if not found or view.since_start - found[-1].view.since_start > 0.99 / SHOWN_RATE:
                recent = {
                    number: [each for each in frames if each[0] > view.since_start - SURFACE]
                    for number, frames in surfaces.items()
                }
                found.append(State(view, np.array(path).reshape(-1, 3), dict(lines), recent))
    return found, camera


def _note_lines(lines: dict[int, FloatArray], estimates: list[LineEstimate]) -> None:
    for line in estimates:
        sigma = max(float(np.sqrt(np.trace(covariance))) for covariance in line.covariance)
        if sigma < _LINE_SIGMA:
            lines[line.id] = line.ends


class Picture:
    """Draws states, all from the same point of view.

    Args:
        last: the last state, which sets the limits.
        camera: that took the images.
    """

    def __init__(self, last: State, camera: CameraModel) -> None:
        self._camera = camera
        ends = np.concatenate([*last.lines.values(), last.path])
        low, high = np.quantile(ends, [0.02, 0.98], axis=0)
        self._low = np.minimum(low, last.path.min(axis=0))
        self._high = np.maximum(high, last.path.max(axis=0))

    def draw(self, state: State) -> Image.Image:
        """One image of the picture."""
        with mpl.rc_context({"font.family": "DejaVu Sans", "text.color": INK}):
            figure = Figure(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100, facecolor=GROUND)
            image: Any = figure.add_axes((0.0, 0.09, 0.385, 0.91))
            image.imshow(draw_overlay(state.view, self._camera)[:-30, :, ::-1])
            image.set_axis_off()
            self._surfaces(figure.add_axes((0.385, 0.05, 0.315, 0.97), projection="3d"), state)
            self._world(figure.add_axes((0.675, 0.06, 0.335, 0.97), projection="3d"), state)
            for left, text in (
                (0.012, "edges and their rulings"),
                (0.40, "ruled surfaces: lines in image and time"),
                (0.71, "trajectory and line map"),
            ):
                figure.text(left, 0.03, text, fontsize=11)
            canvas: Any = FigureCanvasAgg(figure)
            canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3])

    def _surfaces(self, axes: Any, state: State) -> None:
        now = state.view.since_start
        for number, frames in state.surfaces.items():
            if len(frames) < _LONG * RATE:
                continue
            times = np.array([time for time, _ in frames]) - now
            ends = np.array([each for _, each in frames])
            t = np.repeat(times[:, None], 2, axis=1)
            rulings = np.stack([t, ends[:, :, 0], self._camera.height - ends[:, :, 1]], axis=2)
            color = np.array(line_color(number)) / 255.0
            strips = np.concatenate([rulings[:-1], rulings[1:, ::-1]], axis=1)
            axes.add_collection3d(Poly3DCollection(list(strips), facecolors=[(*color, 0.28)]))
            axes.add_collection3d(
                Line3DCollection(list(rulings[::5]), colors=[(*color, 0.55)], linewidths=0.7)
            )
            axes.add_collection3d(
                Line3DCollection([rulings[-1]], colors=[(*color, 1.0)], linewidths=2.0)
            )
        _plain(axes, (-SURFACE, 0, 0), (0.0, self._camera.width, self._camera.height))
        axes.set_box_aspect((1.5, 1.33, 1.0), zoom=1.0)
        axes.view_init(elev=18.0, azim=-50.0)

    def _world(self, axes: Any, state: State) -> None:
        axes.computed_zorder = False
        numbers = list(state.lines)
        colors = [(*(np.array(line_color(number)) / 255.0), 0.85) for number in numbers]
        if numbers:
            ends = [state.lines[number] for number in numbers]
            axes.add_collection3d(Line3DCollection(ends, colors=colors, linewidths=1.5))
        if len(state.path) > 1:
            axes.plot(*state.path.T, color="white", lw=2.0)
            axes.scatter(*state.path[-1], color="white", s=26, zorder=9)
        _plain(axes, self._low, self._high)
        axes.set_box_aspect(self._high - self._low, zoom=1.14)
        axes.view_init(elev=28.0, azim=-48.0)


def _plain(axes: Any, low: Any, high: Any) -> None:
    """Faint panes, no ticks."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.patch.set_alpha(0.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.025))
        axis.line.set_color(FAINT)
        axis.set_ticks([])


@click.command(help=__doc__)
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--seconds", default=11.0, show_default=True, help="Of the recording.")
@click.option("--seed", default=0, show_default=True, help="Of the simulation.")
@click.option("--quality", default=42, show_default=True, help="Of WebP, 0 to 100.")
def main(out: Path, seconds: float, seed: int, quality: int) -> None:
    """Command line."""
    cv2.setNumThreads(1)
    found, camera = states(seconds, seed)
    picture = Picture(found[-1], camera)
    images = []
    for i, state in enumerate(found):
        images.append(picture.draw(state))
        print(f"\r{i + 1} of {len(found)} images", end="", file=sys.stderr, flush=True)
    # The last one stays for two seconds.
    step = round(1000 / SHOWN_RATE)
    durations = [step] * (len(images) - 1) + [2000]
    images[0].save(
        out,
        save_all=True,
        append_images=images[1:],
        duration=durations,
        loop=0,
        quality=quality,
        method=4,
    )
    print(f"\n{out}: {out.stat().st_size / 1e3:.0f} kB", file=sys.stderr)


if __name__ == "__main__":
    main()
