# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Which recordings a folder holds."""

import shutil
from pathlib import Path

import pytest

from recordings import entries_of, sequence, write_asl, write_bag
from ruledgraph.recording import recordings_in


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    entries = entries_of(sequence())
    (tmp_path / "day 1").mkdir()
    write_bag(tmp_path / "day 1" / "b.bag", "rosbag1", entries)
    write_bag(tmp_path / "a", "mcap", entries)
    write_asl(tmp_path / "euroc", sequence())
    (tmp_path / "notes.txt").write_text("#ROSBAG it is not")
    (tmp_path / ".hidden").mkdir()
    shutil.copy(tmp_path / "day 1" / "b.bag", tmp_path / ".hidden")
    return tmp_path


def test_files_bags_and_folders_of_any_kind(folder):
    names = [str(path.relative_to(folder)) for path in recordings_in(folder)]
    assert names == ["a", "day 1/b.bag", "euroc"]


def test_a_link_back_is_not_followed(folder):
    (folder / "day 1" / "back").symlink_to(folder)
    assert len(recordings_in(folder)) == 3


@pytest.mark.parametrize("name", ["a", "euroc"])
def test_a_recording_that_is_a_folder(folder, name):
    assert recordings_in(folder / name) == [folder / name]


@pytest.mark.parametrize(
    ("names", "one"),
    [
        (("x_0.mcap", "x_1.mcap"), True),
        (("x_0.mcap",), True),
        (("x.mcap", "y.mcap"), False),
        (("x_0.mcap", "y_0.mcap"), False),
    ],
)
def test_a_folder_without_metadata_is_a_bag_where_its_files_are_numbered(folder, names, one):
    (file,) = (folder / "a").glob("*.mcap")
    (folder / "c").mkdir()
    for name in names:
        shutil.copy(file, folder / "c" / name)
    found = recordings_in(folder / "c")
    assert found == ([folder / "c"] if one else [folder / "c" / name for name in names])


def test_an_empty_folder(tmp_path):
    assert recordings_in(tmp_path) == []
