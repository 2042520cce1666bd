# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Named points surveyed or tracked in the world, to judge a map of lines by."""

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.plain_yaml import Node, YamlError, read_yaml
from ruledgraph.core.text_table import TableError, read_words
from ruledgraph.evaluation.ground_truth import POSITIONS, inner, position

if TYPE_CHECKING:  # loads the decoders of images and bags
    from ruledgraph.recording.recording import Recording

Markers = dict[str, NDArray[np.float64]]

_VICON = "vicon_bridge/msg/Markers"
# No room is as large: beyond this a Vicon's numbers are millimetres.
_LARGEST_ROOM = 100.0


class MarkersError(RuledgraphError):
    """A file or topic that holds no markers."""


def read_markers(source: str | Path, recording: "Recording | None" = None) -> Markers:
    """Read markers from a file or from topics of a recording.

    Args:
        source: a CSV file of `name,x,y,z`, a YAML file of `name: [x, y, z]`, m, or a pattern of
            topics such as `/vicon/marker*`: each topic of a type with a position is one marker,
            a `vicon_bridge/Markers` topic holds many, named `subject/marker`.
        recording: where to look for topics.

    Returns:
        Name -> position, m, (3,). The mean over the recording for topics.

    Raises:
        MarkersError: names the file and line, or topic, at fault.
        RecordingError: when the recording cannot be read.
    """
    path = Path(source)
    if recording is not None and not path.is_file():
        return _from_topics(str(source), recording)
    try:
        named = _from_yaml(path) if path.suffix in (".yaml", ".yml") else _from_csv(path)
    except (YamlError, TableError) as error:
        raise MarkersError(str(error)) from None
    if not named:
        raise MarkersError(f"{path}: holds no markers")
    return {name: _point(path, name, words) for name, words in named.items()}


def _from_yaml(path: Path) -> dict[str, Node]:
    node = read_yaml(path)
    return dict(node) if isinstance(node, dict) else {}


def _from_csv(path: Path) -> dict[str, Node]:
    named: dict[str, Node] = {}
    for line, words in read_words(path):
        if [word.lower() for word in words] == ["name", "x", "y", "z"]:
            continue
        if len(words) != 4 or words[0] in named:
            fault = f"{words[0]} occurs twice" if len(words) == 4 else "not name,x,y,z"
            raise MarkersError(f"{path}:{line}: {fault}")
        named[words[0]] = list(words[1:])
    return named


def _point(path: Path, name: str, words: Node) -> NDArray[np.float64]:
    try:
        point = np.array(words if isinstance(words, list) else [], dtype=np.float64)
    except (ValueError, TypeError):
        point = np.empty(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise MarkersError(f"{path}: {name[:40]!r} must be 3 numbers, x, y, z in metres")
    return point


def _from_topics(pattern: str, recording: "Recording") -> Markers:
    wanted = pattern.strip("/")
    topics = [t for t in recording.topics if fnmatchcase(t.name.strip("/"), wanted)]
    usable = [t for t in recording.topics if t.type in (*POSITIONS, _VICON)]
    samples: dict[str, list[tuple[float, float, float]]] = {}
    for topic in topics:
        if topic.type == _VICON:
            samples.update(_vicon(recording, topic.name))
        elif topic.type in POSITIONS:
            samples[topic.name.strip("/")] = [
                position(inner(message, topic.type))
                for _, message in recording.messages(topic.name)
            ]
    means = {}
    for name, points in samples.items():
        finite = [point for point in points if np.isfinite(point).all()]
        if finite:
            means[name] = np.mean(finite, axis=0)
    if not means:
        names = ", ".join(topic.name for topic in usable)
        raise MarkersError(f"{pattern}: no markers there; topics with positions: {names or 'none'}")
    return means


def _vicon(recording: "Recording", topic: str) -> dict[str, list[tuple[float, float, float]]]:
    """Labelled markers while they were seen, m."""
    samples: dict[str, list[tuple[float, float, float]]] = {}
    for _, message in recording.messages(topic):
        for marker in message.markers:
            if marker.marker_name and not marker.occluded:
                name = f"{marker.subject_name}/{marker.marker_name}".lstrip("/")
                samples.setdefault(name, []).append(position(marker))
    # vicon_bridge passes on Vicon's millimetres, some of its descendants metres.
    everything = [abs(x) for points in samples.values() for point in points for x in point]
    scale = 1e-3 if max(everything, default=0.0) > _LARGEST_ROOM else 1.0
    return {
        name: [(scale * x, scale * y, scale * z) for x, y, z in points]
        for name, points in samples.items()
    }
