# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What `ruledgraph smooth` writes over, and what it never does."""

import shutil
from pathlib import Path

import pytest

from small_runs import smooth
from small_simulation import write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("smooth force")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    write_small_recording(folder)
    return folder


def test_results_are_never_overwritten(recording, tmp_path):
    (tmp_path / "kept.txt").write_text("mine")
    result = smooth(
        recording / "small.bag", "--calibration", recording / "calib.yaml", "--output", tmp_path
    )
    assert result.exit_code == 2
    assert (
        f"{tmp_path}: is not empty; name another folder with --output, or pass --force"
        in result.output
    )
    assert (tmp_path / "kept.txt").read_text() == "mine"


@pytest.mark.parametrize("output", ["small.bag", "calib.yaml", ".", "another.bag", "bag"])
def test_force_removes_nothing_but_results(recording, tmp_path, output):
    """Neither what is read nor another recording."""
    folder = tmp_path / "room"
    shutil.copytree(recording, folder)
    shutil.copy(folder / "small.bag", folder / "another.bag")
    (folder / "bag").mkdir()
    (folder / "bag" / "bag_0.db3").touch()
    before = sorted(path for path in folder.rglob("*"))
    given = (folder / "small.bag", "--calibration", folder / "calib.yaml")
    result = smooth(*given, "--output", folder / output, "--force")
    assert result.exit_code == 2
    expected = (
        "is read from there" if output in ("small.bag", "calib.yaml", ".") else "no folder of"
    )
    assert expected in result.output
    assert sorted(path for path in folder.rglob("*")) == before
    assert (folder / "small.bag").stat().st_size == (recording / "small.bag").stat().st_size


def test_force_spares_a_recording_that_a_bag_is_written_over(recording, tmp_path):
    bag = tmp_path / "small.bag"
    shutil.copy(recording / "small.bag", bag)
    given = (bag, "--calibration", recording / "calib.yaml", "--output", tmp_path / "run")
    result = smooth(*given, "--ros2-bag", bag, "--force")
    assert result.exit_code == 2
    assert "the ROS 2 bag is an MCAP file, name it *.mcap" in result.output
    assert bag.stat().st_size == (recording / "small.bag").stat().st_size


def test_results_are_overwritten_by_force_alone(recording, tmp_path):
    arguments = (recording / "small.bag", "--calibration", recording / "calib.yaml")
    output = tmp_path / "run"
    output.mkdir()
    (output / "trajectory_live.tum").touch()
    (output / "old.txt").touch()
    arguments += ("--output", output)
    assert smooth(*arguments).exit_code == 2
    assert smooth(*arguments, "--force").exit_code == 0
    assert not (output / "old.txt").exists()


@pytest.mark.parametrize(
    ("option", "fault"),
    [("--video", "a video is an .mp4 file"), ("--ros2-bag", "name it *.mcap")],
)
def test_force_keeps_results_where_another_output_is_impossible(recording, tmp_path, option, fault):
    kept = tmp_path / "run" / "summary.json"
    kept.parent.mkdir()
    kept.write_text("{}")
    (kept.parent / "trajectory_live.tum").touch()
    given = (recording / "small.bag", "--calibration", recording / "calib.yaml")
    result = smooth(*given, "--output", kept.parent, option, tmp_path / "run.txt", "--force")
    assert result.exit_code == 2
    assert fault in result.output
    assert kept.read_text() == "{}"


def test_all_that_is_written_is_replaced_by_force(recording, tmp_path):
    files = tmp_path / "run.mp4", tmp_path / "run.mcap", tmp_path / "run.rrd"
    for file in files:
        file.write_text("old")
    given = (recording / "small.bag", "--calibration", recording / "calib.yaml")
    given += ("--video", files[0], "--ros2-bag", files[1], "--rerun", files[2])
    given += ("--output", tmp_path / "run")
    refused = smooth(*given, "--duration", "2")
    assert refused.exit_code == 2
    assert "exists already" in refused.output
    result = smooth(*given, "--duration", "2", "--force")
    assert result.exit_code == 0, result.output
    assert all(file.stat().st_size > 1000 for file in files)


def test_an_output_that_is_refused_leaves_nothing_of_those_before_it(recording, tmp_path):
    (tmp_path / "run.mcap").write_text("old")
    given = (recording / "small.bag", "--calibration", recording / "calib.yaml")
    given += ("--video", tmp_path / "run.mp4", "--ros2-bag", tmp_path / "run.mcap")
    result = smooth(*given, "--output", tmp_path / "run")
    assert result.exit_code == 2
    assert "run.mcap: exists already" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_run_that_is_refused_leaves_no_other_file(recording, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "notes.txt").touch()
    given = (recording / "small.bag", "--calibration", recording / "calib.yaml")
    given += ("--ros2-bag", tmp_path / "run.mcap", "--video", tmp_path / "run.mp4")
    assert smooth(*given, "--output", tmp_path / "run").exit_code == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]
