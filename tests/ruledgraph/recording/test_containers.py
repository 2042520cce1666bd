# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Every kind of container gives back what was put in, the same as rosbags' own readers."""

import shutil
import struct
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from recordings import (
    BAGS,
    MS,
    T0,
    assert_same,
    entries_of,
    fields,
    image,
    imu,
    sequence,
    serialise,
    texture,
    write_asl,
    write_bag,
)
from ruledgraph.recording import RecordingError, open_recording, write_recording
from ruledgraph.recording.formats import open_container
from ruledgraph.recording.rosbag1 import Rosbag1


@pytest.mark.parametrize("bag", BAGS)
def test_same_messages_as_rosbags(bag: str, tmp_path: Path) -> None:
    # Large enough for several chunks.
    measurements = sequence(2.0, shape=(240, 320))
    # rosbags tells a ROS 1 bag by its name.
    name = "a.bag" if bag.startswith("rosbag1") else "a"
    path = write_bag(tmp_path / name, bag, entries_of(measurements))
    with AnyReader([path]) as reader:
        expected = [(received, c.topic, data) for c, received, data in reader.messages()]
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
    container = open_container(path)
    names = [topic.name for topic in container.topics]
    assert [tuple(message) for message in container.messages(names)] == expected
    assert {topic.name: topic.message_count for topic in container.topics} == counts
    assert container.damage == {}


@pytest.mark.parametrize("bag", BAGS)
def test_stream_gives_back_what_was_recorded(bag: str, tmp_path: Path) -> None:
    measurements = sequence()
    path = write_bag(tmp_path / "recording", bag, entries_of(measurements))
    recording = open_recording(path)
    assert_same(list(recording.stream()), measurements)
    assert recording.report.warnings == []
    # A second pass is the same as the first.
    assert_same(list(recording.stream()), measurements)


def test_bare_files(tmp_path: Path) -> None:
    measurements = sequence()
    for bag, kind in (("mcap", "mcap"), ("sqlite3", "rosbag2"), ("mcap-file", "mcap")):
        folder = write_bag(tmp_path / bag, bag, entries_of(measurements))
        (file,) = [f for f in folder.iterdir() if f.name != "metadata.yaml"]
        # Told by its contents, whatever it is called.
        file = file.rename(tmp_path / f"{bag}.bag.jpg")
        recording = open_recording(file)
        assert recording.kind == kind
        assert_same(list(recording.stream()), measurements)


def test_asl_folder_or_its_mav0(tmp_path: Path) -> None:
    measurements = sequence()
    path = write_asl(tmp_path / "flight.bag", measurements)
    for root in (path, path / "mav0"):
        recording = open_recording(root)
        assert recording.kind == "asl"
        assert [topic.name for topic in recording.topics] == ["cam0", "imu0"]
        assert_same(list(recording.stream()), measurements)


def test_asl_with_windows_line_ends_two_cameras_and_a_path_in_its_names(tmp_path: Path) -> None:
    measurements = sequence()
    path = write_asl(tmp_path / "flight", measurements) / "mav0"
    shutil.copytree(path / "cam0", path / "cam1")
    table = path / "cam0" / "data.csv"
    text = table.read_text().replace(",", ",../../cam1/data/").replace("\n", "\r\n")
    table.write_bytes(text.encode())
    shutil.rmtree(path / "cam1" / "data")
    with pytest.raises(RecordingError, match="--image-topic cam0 or --image-topic cam1"):
        open_recording(path)
    # The folder in a row is ignored: only the sensor's own images are read.
    assert_same(list(open_recording(path, image_topic="cam0").stream()), measurements)


def test_split_rosbag2_is_one_recording(tmp_path: Path) -> None:
    measurements = sequence(3.0)
    parts = [[m for m in measurements if (fields(m)[0] - T0) // 10**9 == i] for i in range(3)]
    folder = tmp_path / "split"
    folder.mkdir()
    # In an order that is not that of the names.
    for name, part in zip("cab", parts, strict=True):
        write_recording(part, folder / f"{name}.mcap", "mcap")
    listed = "".join(f"    - {name}.mcap\n" for name in "abcd")
    (folder / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  relative_file_paths:\n{listed}"
    )
    recording = open_recording(folder)
    assert_same(list(recording.stream()), measurements)
    assert recording.report.warnings == ["metadata.yaml lists d.mcap, which is missing"]


@pytest.mark.parametrize("bag", ["rosbag1", "mcap", "sqlite3"])
def test_topics_written_one_after_the_other(bag: str, tmp_path: Path) -> None:
    measurements = sequence(2.0, shape=(240, 320))
    entries = entries_of(measurements)
    entries.sort(key=lambda entry: entry.topic)
    path = write_bag(tmp_path / "a", bag, entries)
    assert_same(list(open_recording(path).stream()), measurements)


def test_rosbag1_whose_last_chunk_was_never_closed(tmp_path: Path) -> None:
    """As `rosbag record` leaves it when it is killed: no index, and a chunk of size zero."""
    measurements = sequence(2.0, shape=(240, 320))
    path = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(measurements))
    last = Rosbag1(path).blocks[-1]
    assert len(Rosbag1(path).blocks) > 1
    data = bytearray(path.read_bytes()[: last.offset + last.size])
    for name in (b"index_pos=", b"conn_count=", b"chunk_count="):
        at = data.index(name) + len(name)
        data[at : at + 4] = bytes(4)
    at = data.rindex(b"size=", 0, last.offset) + 5
    data[at : at + 4] = data[last.offset - 4 : last.offset] = bytes(4)
    path.write_bytes(data)
    recording = open_recording(path)
    assert_same(list(recording.stream()), measurements)


def test_ros1_messages_in_mcap(tmp_path: Path) -> None:
    def record(op: int, content: bytes) -> bytes:
        return struct.pack("<BQ", op, len(content)) + content

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    measurements = sequence()
    data = b"\x89MCAP0\r\n" + record(1, text("ros1") + text("test"))
    for number, (topic, type_name) in enumerate(
        (("/cam0/image_raw", "sensor_msgs/Image"), ("/imu0", "sensor_msgs/Imu")), 1
    ):
        data += record(3, struct.pack("<H", number) + text(type_name) + text("ros1msg") + text(""))
        data += record(
            4, struct.pack("<HH", number, number) + text(topic) + text("ros1") + text("")
        )
    for entry in entries_of(measurements):
        number = 1 if entry.topic.startswith("/cam") else 2
        head = struct.pack("<HIQQ", number, 0, entry.stamp, entry.stamp)
        data += record(5, head + serialise("ros1", entry))
    data += record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n"
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    recording = open_recording(path)
    assert_same(list(recording.stream()), measurements)
    assert recording.report.warnings == []


def test_messages_of_other_topics(tmp_path: Path) -> None:
    measurements = sequence()
    path = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(measurements))
    recording = open_recording(path)
    stamps = [fields(m)[0] for m in measurements if hasattr(m, "gyroscope")]
    messages = list(recording.messages("imu0"))
    assert [stamp for stamp, _ in messages] == stamps
    assert messages[0][1].linear_acceleration.x == measurements[0][2][0]  # type: ignore[index]
    with pytest.raises(
        RecordingError, match=r"no topic named '/tf' \(topics: /cam0/image_raw, /imu0\)"
    ):
        next(recording.messages("/tf"))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "does not exist"),
        (b"", "is empty"),
        (b"#ROSBAG V1.2\n", "format 1.2; convert it to 2.0"),
        (b"#!/bin/sh\n", "begins like neither a ROS 1 bag, an MCAP file nor a ROS 2 database"),
        (b"SQLite format 3\0", "in its header"),
    ],
)
def test_what_is_no_recording(content: bytes | None, text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=text):
        open_recording(path)


def test_folder_that_is_no_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"holds no recording: no \*\.bag, \*\.mcap or"):
        open_recording(tmp_path)
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(RecordingError, match=r"holds a recording; name one, such as .*a\.bag$"):
        open_recording(tmp_path)


def test_encrypted_bag(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", "rosbag1", [imu(T0), image(T0 + MS, texture(0))])
    data = path.read_bytes()
    # The first header made longer by a field, at the cost of the padding after it.
    field = struct.pack("<I", 15) + b"encryptor=a/b/c"
    length = struct.unpack_from("<I", data, 13)[0]
    end = 13 + 4 + length
    padding = struct.unpack_from("<I", data, end)[0]
    head = struct.pack("<I", length + len(field)) + data[17:end] + field
    head += struct.pack("<I", padding - len(field))
    path.write_bytes(data[:13] + head + data[end + 4 + len(field) :])
    with pytest.raises(RecordingError, match="is encrypted"):
        open_recording(path)
