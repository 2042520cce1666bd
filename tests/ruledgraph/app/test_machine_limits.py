# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Runs that the machine ends: no space, no memory, no thread."""

import json
import resource
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import cv2
import pytest
from click.testing import CliRunner, Result

from ruledgraph.app.cli import main
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.config import Config
from ruledgraph.core.errors import MachineError
from ruledgraph.core.settings import config_text
from ruledgraph.core.trajectory import read_tum
from ruledgraph.live import LiveOdometry
from small_simulation import small_stream, write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("machine limits")

KB = 1024


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    write_small_recording(folder, duration=6.0)
    return folder


def command(*arguments: object, largest: int | None = None, **options) -> list[str]:
    """Run it in a process that may write files of so many bytes; its exit code and error lines,
    without those of progress.
    """
    limit = None
    if largest is not None:
        limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (largest, largest))
    done = subprocess.run(
        [sys.executable, "-m", "ruledgraph", *map(str, arguments)],
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        preexec_fn=limit,
        timeout=120,
        **options,
    )
    lines = done.stderr.splitlines()
    return [str(done.returncode), *(line for line in lines if " frames, " not in line)]


def smooth(recording: Path, *more: object) -> tuple[object, ...]:
    return (
        "smooth",
        recording / "small.bag",
        "--calibration",
        recording / "calib.yaml",
        *more,
    )


def test_without_space_what_was_written_can_be_read(recording, tmp_path):
    # More than config.yaml has; the trajectories have 27 kB each.
    largest = len(config_text(Config()).encode()) + KB
    assert largest < 25 * KB
    out = tmp_path / "out"
    code, *lines = command(*smooth(recording, "--output", out), largest=largest)
    assert code == "4"
    (line,) = lines
    assert line == f"ruledgraph: {out}/trajectory_live.tum: cannot be written: File too large"
    assert (out / "trajectory_live.tum").stat().st_size > largest - KB
    live, smoothed = (read_tum(out / f"{n}.tum") for n in ("trajectory_live", "trajectory"))
    assert len(live.stamps) > 60
    # The window was handed out, too: as many rows as fit, which differ by some digits.
    assert set(live.stamps[:-3]) <= set(smoothed.stamps)
    summary = json.loads((out / "summary.json").read_text())
    assert f"ruledgraph: {summary['ended']}" == line
    assert summary["frames_estimated"] >= len(live)
    rows = (out / "states.csv").read_text().splitlines()
    assert len({row.count(",") for row in rows}) == 1
    assert (out / "lines.ply").exists()


@pytest.mark.parametrize(
    ("option", "name"),
    [("--video", "run.mp4"), ("--ros2-bag", "run.mcap"), ("--rerun", "run.rrd"), ("--plots", "")],
)
def test_another_output_without_space_is_one_line(recording, tmp_path, option, name):
    more = [option, tmp_path / name] if name else [option]
    out = tmp_path / "out"
    # Three seconds of every output have more than that.
    more += ["--duration", 3]
    code, *lines = command(*smooth(recording, "--output", out, *more), largest=60 * KB)
    lines = [line for line in lines if not line.startswith(("warning: ", "\x1b"))]
    assert (code, len(lines)) == ("4", 1), lines
    assert (name or "plots/") in lines[0]
    # The run's own results are whole.
    assert len(read_tum(out / "trajectory.tum").stamps) > 20
    assert "ended" in json.loads((out / "summary.json").read_text())
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["settings"], ["simulate", "-h"]])
def test_a_full_standard_output_is_one_line(arguments):
    with Path("/dev/full").open("w") as full:
        code, *lines = command(*arguments, stdout=full)
    assert code == "4"
    assert lines == ["ruledgraph: output cannot be written: No space left on device"]


def test_a_closed_pipe_is_no_error():
    code, *lines = command("settings", stdout=subprocess.PIPE)
    assert (code, lines) == ("0", [])
    shell = f"{sys.executable} -m ruledgraph settings | head -1"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def in_process(recording: Path, out: Path) -> Result:
    return CliRunner().invoke(main, [str(a) for a in smooth(recording, "--output", out)])


@pytest.mark.parametrize(
    "kind", [MemoryError, partial(MemoryError, "of numpy"), partial(cv2.error, "std::bad_alloc")]
)
def test_without_memory_what_was_written_can_be_read(recording, tmp_path, monkeypatch, kind):
    optimize, calls = Window.optimize, []

    def runs_out(self):
        calls.append(1)
        if len(calls) > 8:
            raise kind()
        return optimize(self)

    monkeypatch.setattr(Window, "optimize", runs_out)
    result = in_process(recording, tmp_path / "out")
    assert result.exit_code == 4
    (line,) = result.stderr.splitlines()
    assert line.startswith("ruledgraph: out of memory")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["ended"].startswith("out of memory")
    poses = read_tum(tmp_path / "out" / "trajectory_live.tum")
    assert len(poses) == summary["frames_estimated"] > 20


def no_thread(self) -> None:  # noqa: ARG001
    raise RuntimeError("can't start new thread")


def test_without_a_thread_it_is_one_line(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(threading.Thread, "start", no_thread)
    result = in_process(recording, tmp_path / "out")
    assert result.exit_code == 4
    (line,) = result.stderr.splitlines()
    assert line.startswith("ruledgraph: no thread could be started")
    assert "no thread" in json.loads((tmp_path / "out" / "summary.json").read_text())["ended"]


def test_live_odometry_without_a_thread(monkeypatch):
    _, calibration = small_stream()
    monkeypatch.setattr(threading.Thread, "start", no_thread)
    with pytest.raises(MachineError, match="no thread could be started"):
        LiveOdometry(calibration)


def test_any_other_error_is_not_hidden(recording, tmp_path, monkeypatch):
    def fails(_):
        raise RuntimeError("a mistake")

    monkeypatch.setattr(Window, "optimize", fails)
    result = in_process(recording, tmp_path / "out")
    assert isinstance(result.exception, RuntimeError)
    assert "a mistake" in json.loads((tmp_path / "out" / "summary.json").read_text())["ended"]
