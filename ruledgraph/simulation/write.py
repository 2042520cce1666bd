# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A simulation as files: the recording, its calibration, and what is true of it."""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn
from scipy.spatial.transform import Rotation

from ruledgraph.calibration import write_kalibr
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.trajectory import TumWriter
from ruledgraph.recording import GroundTruthPose, Kind, write_recording
from ruledgraph.simulation.simulation import Simulation

# True poses are computed so many at a time.
_CHUNK = 1000


class Files(NamedTuple):
    """What `write_simulation` makes, side by side."""

    recording: Path
    calibration: Path
    """Kalibr's format."""
    ground_truth: Path
    """world_T_body at the frames' moments in the IMU's clock, TUM."""
    lines: Path
    """CSV: name and the two end points of every line, m, in the world."""

    @classmethod
    def beside(cls, out: Path) -> "Files":
        """Their names, after the recording's."""
        stem = out.parent / (out.stem if out.suffix in (".bag", ".mcap") else out.name)
        return cls(out, *(Path(f"{stem}.{name}") for name in ("calib.yaml", "gt.tum", "lines.csv")))


def write_simulation(
    simulation: Simulation, out: Path, kind: Kind, on_frame: Callable[[], None] = lambda: None
) -> Files:
    """Write a simulation.

    Args:
        simulation: what to write.
        out: the recording; its true poses are in it, too, see `write_recording`.
        kind: format of the recording.
        on_frame: called after each frame.

    Raises:
        RuledgraphError: when one of the files exists or cannot be written.
    """
    files = Files.beside(out)
    check_free(*files)
    measurements = _counted(simulation.stream(), on_frame)
    write_recording(
        measurements,
        out,
        kind,
        calibration=simulation.calibration,
        ground_truth=_true_poses(simulation),
    )
    write_kalibr(simulation.calibration, files.calibration)
    with TumWriter(files.ground_truth) as writer:
        for pose in _true_poses(simulation):
            writer.append_row(*pose)
    with files.lines.open("x", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["#name", *(f"{axis}{end}" for end in (0, 1) for axis in "xyz")])
        for name, ends in zip(simulation.line_names, simulation.lines, strict=True):
            rows.writerow([name, *ends.ravel().tolist()])
    return files


def write_with_progress(simulation: Simulation, out: Path, kind: Kind) -> Files:
    """`write_simulation` with a progress bar, where standard error is a terminal."""
    console = Console(stderr=True)
    columns = (*Progress.get_default_columns()[:3], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulating", total=len(simulation.frame_times()))
        return write_simulation(simulation, out, kind, lambda: progress.advance(task))


def check_free(*paths: Path) -> None:
    """Make sure that nothing will be overwritten.

    Raises:
        RuledgraphError: names the path that exists.
    """
    for path in paths:
        if path.exists() or path.is_symlink():
            raise RuledgraphError(f"{path} exists already; remove it or choose another name")


def write_contact_sheet(
    simulation: Simulation, path: Path, columns: int = 4, rows: int = 3
) -> None:
    """Frames spread over the whole simulation, in one image 1,600 pixels wide.

    Raises:
        RuledgraphError: when the file exists or cannot be written.
    """
    check_free(path)
    numbers = np.linspace(0, len(simulation.frame_times()) - 1, columns * rows).astype(int)
    camera = simulation.calibration.camera
    width = 1600 // columns
    height = round(width * camera.height / camera.width)
    sheet = np.zeros((rows * height, columns * width), dtype=np.uint8)
    for i, frame in enumerate(simulation.frames(numbers.tolist())):
        row, column = divmod(i, columns)
        small = cv2.resize(frame.image, (width, height), interpolation=cv2.INTER_AREA)
        sheet[row * height : (row + 1) * height, column * width : (column + 1) * width] = small
    try:
        written = cv2.imwrite(str(path), sheet)
    except cv2.error:
        written = False
    if not written:
        raise RuledgraphError(f"{path} cannot be written; use a name that ends in .png")


def _counted(
    measurements: Iterator[Measurement], on_frame: Callable[[], None]
) -> Iterator[Measurement]:
    for measurement in measurements:
        yield measurement
        if isinstance(measurement, Frame):
            on_frame()


def _true_poses(simulation: Simulation) -> Iterator[GroundTruthPose]:
    stamps = simulation.stamps(simulation.frame_times())
    for first in range(0, len(stamps), _CHUNK):
        truth = simulation.truth(stamps[first : first + _CHUNK])
        quaternions = Rotation.from_matrix(truth.rotation).as_quat()
        for row in zip(truth.stamps.tolist(), truth.position, quaternions, strict=True):
            yield GroundTruthPose(*row)
