# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Markers read from files and from topics."""

from types import SimpleNamespace

import numpy as np
import pytest

from ruledgraph.evaluation.markers import MarkersError, read_markers
from truth_bags import START, STORE, pose_message, write_bag


def test_markers_in_files(file):
    csv = file("# surveyed\nname, x, y, z\ndoor left,1,2,3.5\ndoor right,2,2,3.5\n", "m.csv")
    yaml = file("door left: [1, 2, 3.5]\ndoor right: [2.0, 2, 3.5]\n", "m.yaml")
    for path in (csv, yaml):
        markers = read_markers(path)
        assert {name: point.tolist() for name, point in markers.items()} == {
            "door left": [1.0, 2.0, 3.5],
            "door right": [2.0, 2.0, 3.5],
        }


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("m.csv", "a,1,2,3\na,1,2,3\n", ":2: a occurs twice"),
        ("m.csv", "a,1,2\n", ":1: not name,x,y,z"),
        ("m.csv", "a,1,2,x\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.csv", "# nothing\n", ": holds no markers"),
        ("m.yaml", "a: 123\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "a: [1, 2, nan]\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "a: [1, {b: 2}, 3]\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "a: [1, [2], 3]\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "just words\n", ": holds no markers"),
        ("m.yaml", "a: [1\n", ":2: not valid YAML: "),
    ],
)
def test_what_is_wrong_with_markers_is_named(file, name, text, message):
    path = file(text, name)
    with pytest.raises(MarkersError) as error:
        read_markers(path)
    assert str(error.value).startswith(f"{path}{message}")


def test_markers_are_means_over_topics(tmp_path):
    kind = "geometry_msgs/msg/PointStamped"

    def points(*xs):
        return kind, [
            pose_message(kind, START + i, [x, 1.0, 2.0], [0] * 4) for i, x in enumerate(xs)
        ]

    topics = {"/m/one": points(1.0, 2.0, np.nan), "/m/two": points(5.0), "/other": points(7.0)}
    recording = write_bag(tmp_path / "a.bag", topics)
    markers = read_markers("/m/*", recording)
    assert {name: point.tolist() for name, point in markers.items()} == {
        "m/one": [1.5, 1.0, 2.0],
        "m/two": [5.0, 1.0, 2.0],
    }
    with pytest.raises(MarkersError) as error:
        read_markers("/none*", recording)
    names = "/m/one, /m/two, /other"
    assert str(error.value) == f"/none*: no markers there; topics with positions: {names}"


@pytest.mark.parametrize("scale", [1.0, 1000.0], ids=["metres", "millimetres"])
def test_markers_of_a_vicon(scale):
    def marker(name, x, occluded=False, subject="wand"):
        translation = SimpleNamespace(x=x * scale, y=2.0 * scale, z=3.0 * scale)
        return SimpleNamespace(
            marker_name=name, subject_name=subject, translation=translation, occluded=occluded
        )

    messages = [
        SimpleNamespace(markers=[marker("a", 1.0), marker("b", 9.0, occluded=True)]),
        SimpleNamespace(markers=[marker("a", 2.0), marker("", 8.0), marker("c", 4.0, subject="")]),
    ]
    recording = SimpleNamespace(
        topics=[SimpleNamespace(name="/vicon/markers", type="vicon_bridge/msg/Markers")],
        messages=lambda _: ((0, message) for message in messages),
    )
    markers = read_markers("/vicon/markers", recording)
    assert markers.keys() == {"wand/a", "c"}
    np.testing.assert_allclose(markers["wand/a"], [1.5, 2.0, 3.0])
    np.testing.assert_allclose(markers["c"], [4.0, 2.0, 3.0])


def test_vicon_markers_of_a_bag(tmp_path):
    kinds = {name: STORE.types[f"vicon_bridge/msg/{name}"] for name in ("Marker", "Markers")}
    point, header = STORE.types["geometry_msgs/msg/Point"], STORE.types["std_msgs/msg/Header"]
    time = STORE.types["builtin_interfaces/msg/Time"]
    messages = [
        kinds["Markers"](
            header=header(seq=i, stamp=time(sec=1, nanosec=i), frame_id="vicon"),
            frame_number=i,
            markers=[
                kinds["Marker"]("corner", "board", "", point(1000.0 + i, 2000.0, 3000.0), False),
                kinds["Marker"]("hidden", "board", "", point(0.0, 0.0, 0.0), True),
            ],
        )
        for i in (0, 2)
    ]
    bag = write_bag(tmp_path / "a.bag", {"/vicon/markers": ("vicon_bridge/msg/Markers", messages)})
    markers = read_markers("/vicon/markers", bag)
    assert list(markers) == ["board/corner"]
    np.testing.assert_allclose(markers["board/corner"], [1.001, 2.0, 3.0])
