# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What recorders write that no reader expects: it is used where it can be, and reported."""

import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from recordings import BAGS, assert_same, entries_of, imu, sequence, write_bag
from ruledgraph.diagnostics.info import inspect_recording
from ruledgraph.recording import open_recording
from ruledgraph.recording.formats import open_container


def database_of(bag: Path) -> Path:
    (file,) = bag.glob("*.db3")
    return file


def altered(tmp_path: Path, *statements: str) -> Path:
    """A ROS 2 bag after changes of its database."""
    bag = write_bag(tmp_path / "a", "sqlite3", entries_of(sequence()))
    # Columns without types and constraints.
    loose = [
        "CREATE TABLE m (id, topic_id, timestamp, data)",
        "INSERT INTO m SELECT id, topic_id, timestamp, data FROM messages",
        "DROP TABLE messages",
        "ALTER TABLE m RENAME TO messages",
        "CREATE TABLE t (id, name, type, serialization_format)",
        "INSERT INTO t SELECT id, name, type, serialization_format FROM topics",
        "DROP TABLE topics",
        "ALTER TABLE t RENAME TO topics",
    ]
    with closing(sqlite3.connect(database_of(bag))) as database:
        for statement in (*loose, *statements):
            database.execute(statement)
        database.commit()
    return bag


def test_a_reader_may_be_closed_in_another_thread(tmp_path):
    """As by the collector of garbage after an error."""
    container = open_container(write_bag(tmp_path / "a", "sqlite3", entries_of(sequence())))
    messages = container.messages([topic.name for topic in container.topics])
    next(messages)
    with ThreadPoolExecutor(1) as thread:
        thread.submit(messages.close).result()


@pytest.mark.parametrize(
    ("statement", "lost"),
    [
        ("UPDATE messages SET timestamp = 'noon' WHERE id % 10 = 3", 11),
        ("UPDATE messages SET data = 7 WHERE id % 10 = 3", 11),
        ("UPDATE messages SET data = NULL WHERE id % 10 = 3", 11),
        ("UPDATE messages SET topic_id = 'x' WHERE id % 10 = 3", 11),
        ("UPDATE messages SET topic_id = 99 WHERE id = 4", 1),
        ("UPDATE messages SET topic_id = NULL WHERE id = 4", 1),
    ],
)
def test_rows_of_other_types_are_counted(tmp_path, statement, lost):
    recording = open_recording(altered(tmp_path, statement))
    assert len(list(recording.stream())) == 110 - lost
    (warning,) = recording.report.warnings
    rows = "row" if lost == 1 else "rows"
    assert f".db3: {lost} {rows} of messages" in warning


def test_times_of_reception_as_floating_point_numbers_will_do(tmp_path):
    bag = altered(tmp_path, "UPDATE messages SET timestamp = timestamp + 0.5 WHERE id % 10 = 3")
    recording = open_recording(bag)
    assert_same(list(recording.stream()), sorted(sequence(), key=lambda m: m.stamp))
    assert recording.report.warnings == []


def test_messages_stored_as_text_are_messages(tmp_path):
    bag = altered(tmp_path, "UPDATE messages SET data = CAST(data AS TEXT) WHERE id % 10 = 3")
    recording = open_recording(bag)
    assert len(list(recording.stream())) == 110
    assert recording.report.warnings == []


@pytest.mark.parametrize(
    ("value", "shown"),
    [("7", "7"), ("NULL", "None"), ("x'ff00'", "\N{REPLACEMENT CHARACTER}\\x00")],
)
def test_a_topic_whose_name_is_no_text_is_shown(tmp_path, value, shown):
    bag = altered(tmp_path, f"UPDATE topics SET name = {value} WHERE type LIKE '%Imu'")
    recording = open_recording(bag)
    assert shown in [topic.name for topic in recording.topics]
    assert len(list(recording.stream())) == 110


def test_a_topic_without_a_number_is_reported(tmp_path):
    bag = altered(tmp_path, "UPDATE topics SET id = 'x' WHERE type LIKE '%Imu'")
    info = inspect_recording(bag)
    assert any("100 rows of messages belong to no topic" in line for line in info.warnings)
    assert any("no IMU" in line for line in info.missing)


@pytest.mark.parametrize("bag", BAGS)
@pytest.mark.parametrize("odd", ["/cam\x07era", "/new\nline", "/\x1b[31mred", "/tab\t", "/del\x7f"])
def test_a_topic_name_with_control_characters_harms_nothing_else(bag, odd, tmp_path):
    measurements = sequence()
    entries = entries_of(measurements)
    stamp = entries[0].stamp
    entries.insert(1, imu(stamp, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0])._replace(topic=odd))
    path = write_bag(tmp_path / "a", bag, entries)
    shown = odd.encode("unicode_escape").decode()
    recording = open_recording(path, imu_topic="/imu0")
    assert_same(list(recording.stream()), sorted(measurements, key=lambda m: m.stamp))
    assert recording.report.warnings == []
    assert shown in [topic.name for topic in recording.topics]
    # By that name it can be chosen.
    ((_, message),) = recording.messages(shown)
    assert message.angular_velocity.y == 2.0


def test_a_type_name_with_control_characters_is_only_another_type(tmp_path):
    bag = altered(
        tmp_path,
        "INSERT INTO topics VALUES (9, '/odd', 'a\x07b', 'cdr')",
        "INSERT INTO messages (id, topic_id, timestamp, data) VALUES (999, 9, 1, x'00')",
    )
    recording = open_recording(bag)
    assert len(list(recording.stream())) == 110
    assert any(topic.type == "a\\x07b" for topic in recording.topics)
