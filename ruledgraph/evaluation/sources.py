# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories and lines to evaluate, from wherever they are."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.evaluation.markers import Markers, read_markers
from ruledgraph.evaluation.matching import EvaluationError

if TYPE_CHECKING:  # loads the decoders of images and bags
    from ruledgraph.recording import Recording

_SMOOTHED, _LIVE, _LINES = "trajectory.tum", "trajectory_live.tum", "lines.csv"


def read_poses(source: str, live: bool = False) -> GroundTruth:
    """Read what `read_ground_truth` reads, a run's folder, or a topic as `recording.bag:/topic`.

    Args:
        source: file, folder or recording and topic.
        live: of a run's folder take the live instead of the smoothed trajectory.

    Raises:
        TrajectoryError: names what cannot be read.
        RecordingError: for a recording that cannot be read.
    """
    folder = Path(source)
    if folder.is_dir():
        path = folder / (_LIVE if live else _SMOOTHED)
        if not path.is_file():
            raise EvaluationError(f"{folder}: holds no {path.name}; name a run's folder or a file")
        return read_ground_truth(path)
    if live:
        raise EvaluationError(f"{source}: --live is for a run's folder, and this is none")
    return read_ground_truth(*_file_or_topic(source))


def read_marker_points(source: str) -> Markers:
    """Read what `read_markers` reads: a file, or topics as `recording.bag:/vicon/marker*`.

    Raises:
        MarkersError: names what cannot be read.
        RecordingError: for a recording that cannot be read.
    """
    return read_markers(*_file_or_topic(source))


def _file_or_topic(source: str) -> tuple[str, "Recording | None"]:
    recording, colon, topic = source.partition(":/")
    if not colon or Path(source).exists() or not Path(recording).exists():
        return source, None
    from ruledgraph.recording import Recording
    from ruledgraph.recording.formats import open_container

    return f"/{topic}", Recording(open_container(Path(recording)), None, None)


def read_line_ends(folder: Path) -> FloatArray:
    """End points of the lines of a run, in its world, (L, 2, 3), m.

    Raises:
        EvaluationError: when there are none to be read.
    """
    path = folder / _LINES
    try:
        with path.open(encoding="ascii", newline="") as file:
            rows = [
                [[float(row[f"{axis}{end}"]) for axis in "xyz"] for end in (1, 2)]
                for row in csv.DictReader(file)
            ]
    except (OSError, KeyError, TypeError, ValueError):
        raise EvaluationError(f"{path}: is no run's table of lines; name a run's folder") from None
    return np.array(rows).reshape(-1, 2, 3)
