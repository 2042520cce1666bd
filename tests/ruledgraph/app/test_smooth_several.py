# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth` of several recordings, and of a folder of them."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ruledgraph.app import smooth_several
from ruledgraph.app.batch.work import run_job
from ruledgraph.app.cli import main
from ruledgraph.core.trajectory import read_tum
from small_simulation import small_simulation, write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("smooth several")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two good recordings and a broken one."""
    folder = tmp_path_factory.mktemp("flights")
    write_small_recording(folder)
    (folder / "day").mkdir()
    shutil.copy(folder / "small.bag", folder / "day" / "again.bag")
    (folder / "broken.bag").write_bytes(b"#ROSBAG V2.0\nand then nothing")
    simulation = small_simulation()
    true = simulation.ground_truth
    for name in ("small", "day/again"):
        write_truth(true, folder / f"{name}.gt.tum")
    return folder


def write_truth(true, path: Path) -> None:
    from scipy.spatial.transform import Rotation

    from ruledgraph.core.trajectory import Trajectory

    quaternions = Rotation.from_matrix(true.rotation).as_quat()
    Trajectory(true.stamps, true.position, quaternions).write_tum(path)


@pytest.fixture
def run_here(monkeypatch) -> None:
    """In this process, which is faster."""

    def in_turn(jobs, done):
        for job in jobs:
            done(job, run_job(job))

    monkeypatch.setattr(smooth_several, "run_in_turn", in_turn)


def smooth(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["smooth", *map(str, arguments)])


@pytest.mark.usefixtures("run_here")
def test_a_folder(folder, tmp_path):
    result = smooth(
        folder,
        *("--calibration", folder / "calib.yaml", "--output", tmp_path / "out"),
        *("--ground-truth", "{folder}/{stem}.gt.tum", "--duration", "3.5", "--plots"),
        *("--trajectory-format", "kitti", "--time-offset", "0.001"),
    )
    assert result.exit_code == 1
    assert "2 of 3 runs are complete, 1 failed" in result.output
    assert result.output.count("failed: broken-") == 1
    assert re.search(r"small-\w+: \d+ of \d+ frames estimated, ATE smoothed .* mm", result.output)
    rows = list(csv.DictReader((tmp_path / "out" / "table.csv").read_text().splitlines()))
    assert [Path(row["recording"]).name for row in rows] == ["broken.bag", "again.bag", "small.bag"]
    for row in rows[1:]:
        run = tmp_path / "out" / row["run"]
        summary = json.loads((run / "summary.json").read_text())
        assert summary["frames"] < 0.8 * 135
        assert summary["time_offset"]["given_s"] == 0.001
        assert float(row["ate_live_mm"]) < 20.0
        assert len(read_tum(run / "trajectory.tum")) == int(row["frames_estimated"])
        assert (run / "trajectory_kitti.txt").exists()
        assert (run / "plots" / "trajectory.png").exists()
    # The same recording twice: the same numbers.
    assert rows[1]["ate_live_mm"] == rows[2]["ate_live_mm"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "3 runs compared" in page
    assert "broken.bag" in page
    assert page.count("data:image/png") == 1


def test_two_files_each_in_a_process_of_its_own(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bags = folder / "small.bag", folder / "broken.bag"
    result = smooth(*bags, "--calibration", folder / "calib.yaml", "--duration", "2")
    assert result.exit_code == 1
    assert "1 of 2 runs are complete" in result.output
    (out,) = (tmp_path / "results").glob("small-*")
    again = smooth(
        *bags, "--calibration", folder / "calib.yaml", "--duration", "2", "--output", out
    )
    assert "1 of 2 runs are there already" in again.output


@pytest.mark.usefixtures("run_here")
def test_an_interrupted_one_is_run_again(folder, tmp_path, monkeypatch):
    def interrupted(jobs, done):
        done(jobs[0], run_job(jobs[0]))
        raise KeyboardInterrupt

    bags = folder / "small.bag", folder / "day" / "again.bag"
    options = ("--calibration", folder / "calib.yaml", "--output", tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setattr(smooth_several, "run_in_turn", interrupted)
        first = smooth(*bags, *options)
    assert first.exit_code == 130
    assert "interrupted: the same command goes on where it was" in first.output
    second = smooth(*bags, *options)
    assert second.exit_code == 0
    assert "1 of 2 runs are there already" in second.output


@pytest.mark.usefixtures("run_here")
def test_one_that_yields_nothing_failed_and_says_why(folder, tmp_path):
    """Without lines that are long enough."""
    bags = folder / "small.bag", folder / "day" / "again.bag"
    options = ("--calibration", folder / "calib.yaml", "--start", 1.5, "--duration", 1.5)
    options += ("--set", "tracks.min_length_px=9000", "--output", tmp_path / "out")
    result = smooth(*bags, *options)
    assert result.exit_code == 1
    assert "0 of 2 runs are complete, 2 failed" in result.output
    assert result.output.count("no frame could be estimated; likely cause: ") == 2


@pytest.mark.parametrize(
    "option", [["--video", "a.mp4"], ["--rerun", "a.rrd"], ["--solver", "paper"], ["--verbose"]]
)
def test_what_goes_with_one_recording_only_is_refused(folder, option):
    result = smooth(folder, "--calibration", folder / "calib.yaml", *option)
    assert result.exit_code == 2
    assert f"{option[0]}" in result.output
    assert "works with a single recording only" in result.output


def test_a_setting_has_one_value(folder):
    """As where one recording is smoothed; several are for `batch`."""
    options = "--calibration", folder / "calib.yaml", "--set", "window.lag=1,2"
    result = smooth(folder, *options)
    assert result.exit_code == 2
    assert "window.lag" in result.output


def test_a_folder_of_nothing_is_one_line(tmp_path):
    result = smooth(tmp_path, "--calibration", "c.yaml")
    assert result.exit_code == 2
    assert "holds no recording" in result.output


def test_a_single_recordings_names_are_filled_in_too(folder, tmp_path):
    result = smooth(
        folder / "small.bag",
        *("--calibration", "{folder}/calib.yaml", "--ground-truth", "{folder}/{stem}.gt.tum"),
        *("--output", tmp_path / "out", "--duration", "3"),
    )
    assert result.exit_code == 0, result.output
    assert "ATE live" in result.output
