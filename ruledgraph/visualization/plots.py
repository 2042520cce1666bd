# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The pictures of a run, in its folder: figures of its files, and overlays of its images."""

from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
from matplotlib.figure import Figure

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.figure_style import save_figure
from ruledgraph.core.measurements import Frame
from ruledgraph.core.text_file import write_whole
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.innovation_figure import innovation_figure
from ruledgraph.visualization.overlay import Image, draw_overlay
from ruledgraph.visualization.run_tables import read_run_tables
from ruledgraph.visualization.state_figures import consistency_figure, state_figure, status_figure
from ruledgraph.visualization.surface_figures import directrix_figure, ruled_surface_figure
from ruledgraph.visualization.trajectory_figure import trajectory_figure
from ruledgraph.visualization.views import View, ViewQueue

if TYPE_CHECKING:
    from ruledgraph.core.arrays import FloatArray

DPI = 130
# An overlay is kept this often, s, and this many at most: then every second one is dropped.
_OVERLAY_INTERVAL, _MAX_OVERLAYS = 1.0, 12
# Ruled surfaces are shown of this long a stretch from the first start, s.
_SURFACE_LENGTH = 2.5


class PlotRecorder:
    """Collects what the pictures need while a run goes on, then draws them."""

    def __init__(self, camera: CameraModel) -> None:
        self._camera = camera
        self._overlays: dict[int, Image] = {}
        self._interval = _OVERLAY_INTERVAL
        self._last_overlay = 0
        self._surfaces: dict[int, list[tuple[float, FloatArray]]] = defaultdict(list)
        self._first: int | None = None
        self._views = ViewQueue()

    def watch(self, odometry: Odometry, frame: Frame) -> None:
        """See the state when a frame has been added."""
        for view in self._views.take(odometry, frame):
            if odometry.window is not None:
                self._keep(view)

    def _keep(self, view: View) -> None:
        stamp = view.frame.stamp
        self._first = stamp if self._first is None else self._first
        time = (stamp - self._first) * 1e-9
        if time <= _SURFACE_LENGTH:
            for line in view.lines:
                if line.in_graph:
                    ends = self._camera.distort(line.points[[0, -1]]).pixels
                    self._surfaces[line.id].append((time, ends))
        if (stamp - self._last_overlay) * 1e-9 >= self._interval:
            self._last_overlay = stamp
            self._overlays[stamp] = draw_overlay(view, self._camera)
            if len(self._overlays) > _MAX_OVERLAYS:
                self._overlays = dict(list(self._overlays.items())[::2])
                self._interval *= 2.0

    def draw(self, output: Path, truth: GroundTruth | None, *, directrices: bool = False) -> None:
        """Write the PNGs into `output/plots`."""
        folder = output / "plots"
        folder.mkdir()
        for stamp, image in self._overlays.items():
            png = cv2.imencode(".png", image)[1].tobytes()
            write_whole(folder / f"overlay_{stamp}.png", png)
        figures = {}
        if self._surfaces:
            figures["ruled_surfaces"] = ruled_surface_figure(self._surfaces, self._camera)
        with suppress(RuledgraphError):  # without poses there is nothing to draw
            figures |= result_figures(output, truth, directrices=directrices)
        for name, figure in figures.items():
            save_figure(figure, folder / f"{name}.png", DPI)


def result_figures(
    folder: Path, truth: GroundTruth | None, *, directrices: bool = False
) -> dict[str, Figure]:
    """What the files of a run show, without its recording: name -> figure.

    Raises:
        RuledgraphError: when there are no poses, or a table cannot be read.
    """
    run = read_run_tables(folder)
    try:
        figures = {"trajectory": trajectory_figure(run, truth)}
        consistency = consistency_figure(run, truth) if truth is not None else None
        if consistency is not None:
            figures["consistency"] = consistency
        innovations = innovation_figure(run)
        if innovations is not None:
            figures["innovations"] = innovations
        figures |= {"status": status_figure(run), "states": state_figure(run)}
        if directrices:
            figures["directrices"] = directrix_figure(run)
    except (KeyError, ValueError) as error:
        raise RuledgraphError(f"{folder}: its tables are not those of a run: {error}") from None
    return figures
