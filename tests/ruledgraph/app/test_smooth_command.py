# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth` as a user runs it, and what it leaves behind."""

import csv
import itertools
import json
import os
import re
import signal
import threading
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from evo.tools import file_interface

from ruledgraph.app.run_input import RunInput
from ruledgraph.app.runner import run
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import ImuSample
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import Trajectory, read_tum
from ruledgraph.recording import write_recording
from small_runs import smooth
from small_simulation import frames, small_simulation, small_stream, write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("smooth command")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    write_small_recording(folder)
    true = small_simulation().ground_truth
    rotations = np.tile([0.0, 0.0, 0.0, 1.0], (len(true.stamps), 1))
    Trajectory(true.stamps, true.position, rotations).write_tum(folder / "truth.tum")
    return folder


@pytest.fixture(scope="module")
def results(recording, tmp_path_factory) -> tuple[Path, Result]:
    output = tmp_path_factory.mktemp("results") / "run1"
    result = smooth(
        recording / "small.bag",
        *("--calibration", recording / "calib.yaml"),
        *("--ground-truth", recording / "truth.tum"),
        *("--output", output, "--plots", "-v"),
        *("--set", "window.lag=1.4"),
    )
    return output, result


def test_it_says_what_came_of_it(results):
    output, result = results
    assert result.exit_code == 0, result.output
    summary = json.loads((output / "summary.json").read_text())
    rmse = 1e3 * summary["accuracy"]["trajectory"]["ate_rmse"]
    assert f"ATE smoothed {rmse:.1f} mm RMSE" in result.output
    estimated = f"{summary['frames_estimated']} of {summary['frames']} estimated"
    assert f"Frames       {estimated}" in result.output
    assert re.search(r"Status       .*tracking \d+\.\d %", result.output)
    assert "smoother: " in result.output
    assert f"Results      {output}" in result.output
    assert result.output.endswith(f"Next         ruledgraph report {output}\n")


def test_all_files_are_there_and_evo_reads_the_trajectories(results):
    output, _ = results
    stamps = {frame.stamp for frame in frames(small_stream()[0])}
    for name in ("trajectory.tum", "trajectory_live.tum"):
        ours = read_tum(output / name)
        assert set(ours.stamps.tolist()) <= stamps
        theirs = file_interface.read_tum_trajectory_file(output / name)
        np.testing.assert_array_equal(theirs.positions_xyz, ours.positions)
    with (output / "states.csv").open() as file:
        states = list(csv.DictReader(file))
    assert len(states) > 20
    gravity = np.array([[float(row[f"gravity_in_body_{a}"]) for a in "xyz"] for row in states])
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 9.81, rtol=1e-6)
    assert all(float(row["sigma_velocity_x"]) > 0.0 for row in states)
    with (output / "lines.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) > 5
    assert all(float(row["covariance1_xx"]) >= 0.0 for row in lines)
    assert load_config(output / "config.yaml") == load_config(None, ["window.lag=1.4"])


def test_the_summary_has_the_figures(results):
    output, _ = results
    summary = json.loads((output / "summary.json").read_text())
    assert summary["ended"] == "complete"
    assert Path(summary["inputs"]["recording"]).name == "small.bag"
    assert Path(summary["inputs"]["ground truth"]).name == "truth.tum"
    assert "start" not in summary["inputs"]
    assert summary["versions"].startswith("ruledgraph ")
    assert summary["machine"].endswith(" cores")
    assert summary["frames"] == len(frames(small_stream()[0]))
    assert summary["accuracy"]["trajectory"]["ate_rmse"] < 0.02
    assert summary["accuracy"]["trajectory_live"]["ate_rmse"] < 0.02
    assert summary["recoveries"] == []
    assert 0.1 < summary["edge_sigma_px"] < 1.0  # rendered edges are sharper than it begins with
    assert {"gradient", "search", "smoother", "detection"} <= set(summary["stages"])
    assert summary["stages"]["smoother"]["p99_ms"] <= summary["stages"]["smoother"]["max_ms"]


def test_the_pictures_are_drawn(results):
    output, _ = results
    names = {path.name for path in (output / "plots").iterdir()}
    assert {
        "trajectory.png",
        "consistency.png",
        "status.png",
        "states.png",
        "ruled_surfaces.png",
    } <= names
    assert "directrices.png" not in names
    assert sum(name.startswith("overlay_") for name in names) >= 2


def test_a_calibration_for_another_size_is_named(recording, tmp_path):
    text = (recording / "calib.yaml").read_text().replace("[320, 240]", "[640, 480]")
    (tmp_path / "other.yaml").write_text(text)
    result = smooth(
        *(recording / "small.bag", "--calibration", tmp_path / "other.yaml"),
        *("--output", tmp_path / "out"),
    )
    assert result.exit_code == 2
    assert f"{tmp_path}/other.yaml: frames are 320x240, but the calibration is" in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no calibration; pass --calibration FILE"),
        (("--calibration", "CALIB", "--set", "window.lga=2"), "window.lga: no such setting"),
        (("--calibration", "CALIB", "--image-topic", "/cam7"), "/cam7"),
        (("--calibration", "CALIB", "--ground-truth", "/nowhere"), "/nowhere"),
        (("--calibration", "missing.yaml"), "missing.yaml"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(recording, tmp_path, arguments, message):
    filled = [recording / "calib.yaml" if a == "CALIB" else a for a in arguments]
    result = smooth(recording / "small.bag", "--output", tmp_path / "out", *filled)
    assert result.exit_code == 2
    assert message in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_recording_that_does_not_exist():
    result = smooth("nothing.bag", "--calibration", "nothing.yaml")
    assert result.exit_code == 2
    assert "nothing.bag" in result.output
    assert "Traceback" not in result.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_run_between_two_measurements(tmp_path, number):
    """Every frame that was estimated live is there smoothed, too."""
    stream, calibration = small_stream()
    before = signal.getsignal(number)

    def signalled():
        for i, measurement in enumerate(stream):
            if i == len(stream) // 2:
                os.kill(os.getpid(), number)
            yield measurement

    summary = run(RunInput(signalled(), calibration), Config(), tmp_path / "out")
    assert (summary["ended"], summary["signal"]) == ("interrupted", number)
    assert signal.getsignal(number) is before
    live, smoothed = (
        read_tum(tmp_path / "out" / f"{name}.tum") for name in ("trajectory_live", "trajectory")
    )
    assert len(live.stamps) == summary["frames_estimated"] > 20
    assert set(live.stamps) <= set(smoothed.stamps)


def test_an_interrupt_leaves_everything_up_to_then(tmp_path):
    stream, calibration = small_stream()

    def interrupted():
        yield from stream[: len(stream) // 2]
        raise KeyboardInterrupt

    summary = run(RunInput(interrupted(), calibration), Config(), tmp_path / "out")
    assert summary["ended"] == "interrupted"
    poses = read_tum(tmp_path / "out" / "trajectory.tum")
    assert len(poses) == summary["frames_estimated"]
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == summary


def test_whatever_goes_wrong_is_on_record_and_the_reader_ends(tmp_path):
    stream, calibration = small_stream()
    closed = threading.Event()

    def reading():
        try:
            yield from stream
            yield from itertools.repeat(stream[-1])
        finally:
            closed.set()

    def observe(step):
        if step.frame is not None and step.frame.stamp > stream[len(stream) // 2].stamp:
            raise LookupError("a mistake")

    class Reader(RunInput):
        def warnings(self):
            # Who reads has ended: what it counted does not change any more.
            assert closed.is_set()
            return ["a warning"]

    output, observers = tmp_path / "out", [observe]
    with pytest.raises(LookupError):
        run(Reader(reading(), calibration), Config(), output, observers=observers)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["ended"] == "LookupError: a mistake"
    assert summary["warnings"][0] == "a warning"
    assert summary["frames_estimated"] == len(read_tum(tmp_path / "out" / "trajectory.tum"))


def test_a_recording_without_motion_says_so(tmp_path):
    stream, calibration = small_stream(moving=True)
    only_imu = [m for m in stream if isinstance(m, ImuSample)]
    summary = run(RunInput(only_imu, calibration), Config(), tmp_path / "out")
    assert summary["frames_estimated"] == 0
    assert summary["warnings"][-1] == "the odometry never started"


def test_the_readmes_python_runs(recording, tmp_path, monkeypatch, capsys):
    readme = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", readme, flags=re.DOTALL | re.MULTILINE)
    (block,) = [block for block in blocks if "ruledgraph.smooth" in block]
    (tmp_path / "flight.bag").symlink_to(recording / "small.bag")
    (tmp_path / "calib.yaml").symlink_to(recording / "calib.yaml")
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "README.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) > 60


def test_without_an_estimate_it_failed_and_says_why(recording, tmp_path):
    """From motion, without lines that are long enough."""
    arguments = ("--calibration", recording / "calib.yaml", "--start", 1.5, "--duration", 1.5)
    arguments += ("--set", "tracks.min_length_px=9000")
    result = smooth(recording / "small.bag", *arguments, "--output", tmp_path / "out")
    assert result.exit_code == 3, result.output
    assert "failed: no frame could be estimated" in result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == {"without estimate": summary["frames"]}
    assert any("it starts in motion" in cause for cause in summary["likely_causes"])
    # Edges are counted as this run wanted them.
    assert any("has 0 straight edges of 9000 px" in cause for cause in summary["likely_causes"])
    assert f"likely cause: {summary['likely_causes'][0]}" in result.output


def test_the_time_offset_can_be_given(recording, tmp_path):
    arguments = ("--calibration", recording / "calib.yaml", "--duration", 1.0)
    given = ("--time-offset", -0.012, "--set", "time_offset.estimate=false")
    result = smooth(recording / "small.bag", *arguments, *given, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "-12.0 ms as given, not estimated" in result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["inputs"]["time offset"] == "-0.012"
    assert summary["time_offset"]["s"] == summary["time_offset"]["given_s"] == -0.012
    assert not summary["time_offset"]["estimated"]


def test_the_readout_can_be_given(recording, tmp_path):
    arguments = ("--calibration", recording / "calib.yaml", "--duration", 1.0, "--readout", 0.01)
    result = smooth(recording / "small.bag", *arguments, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["inputs"]["readout"] == "0.01"
    assert summary["readout_s"] == pytest.approx(0.01, rel=1e-12)


@pytest.mark.parametrize(
    ("readout", "message"),
    [
        ("-0.01", "-0.01 is not in the range 0.0<=x<=1.0"),
        ("20", "20.0 is not in the range 0.0<=x<=1.0"),
        ("nan", "ruledgraph: line_delay = nan s is negative or not finite"),
        (
            "0.05",
            "ruledgraph: images come 33.3 ms apart, but the rows of one are read within 50.0 ms: "
            "check line_delay (s per row) or --readout (s)",
        ),
    ],
)
def test_a_readout_that_cannot_be_is_refused(recording, tmp_path, readout, message):
    arguments = ("--calibration", recording / "calib.yaml", "--readout", readout)
    result = smooth(recording / "small.bag", *arguments, "--output", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert message in result.output
    assert "Traceback" not in result.output


@pytest.mark.parametrize("status", ["degraded", "tracking"])
def test_the_causes_are_said_where_few_estimates_are_reliable(tmp_path, status):
    """Velocities that count as known, or not."""

    class Input(RunInput):
        def likely_causes(self):
            return ["a cause"]

    stream, calibration = small_stream(moving=True)
    sigma = 0.001 if status == "degraded" else 10.0
    config = load_config(None, [f"integrity.tracking_velocity_sigma={sigma}"])
    summary = run(Input(stream, calibration), config, tmp_path / "out")
    assert summary["frames_estimated"] > 0.5 * summary["frames"]
    assert summary["status"][status] > 0.5 * summary["frames"]
    assert summary.get("likely_causes", []) == (["a cause"] if status == "degraded" else [])


def test_a_folder_without_calibration_is_told_what_to_pass(tmp_path):
    write_recording(small_stream(duration=1.0)[0], tmp_path / "asl", "asl")
    result = smooth(tmp_path / "asl", "--output", tmp_path / "out")
    assert result.exit_code == 2
    assert f"{tmp_path / 'asl'}: no calibration; pass --calibration FILE" in result.output


def test_the_console_says_where_the_status_of_each_frame_is(results):
    output, result = results
    assert f"the status of each frame: {output / 'live_frames.csv'}" in result.output
    with (output / "live_frames.csv").open() as file:
        statuses = Counter(row["status"] for row in csv.DictReader(file))
    summary = json.loads((output / "summary.json").read_text())
    assert statuses == {k: n for k, n in summary["status"].items() if k != "without estimate"}
