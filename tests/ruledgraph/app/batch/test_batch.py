# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Batches: what they consist of, what is kept, workers that die."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from ruledgraph.app import batch_command
from ruledgraph.app.batch.jobs import Job, plan, values_of
from ruledgraph.app.batch.store import Store
from ruledgraph.app.batch.work import Outcome, run_job
from ruledgraph.app.cli import main
from ruledgraph.app.input_options import InputOptions
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import read_tum

SMALL = "sim:noncoplanar_cluttered:free?rate=30&duration=2&resolution=320x240"


def planned(
    *patterns: str, inputs: InputOptions | None = None, settings=(), **options
) -> list[Job]:
    choices = [values_of(setting) for setting in settings]
    return plan(patterns, inputs or InputOptions(), choices=choices, **options)


def calibrated(*files: str) -> InputOptions:
    return InputOptions(calibration_files=files)


def test_every_recording_with_every_choice(tmp_path):
    for name in ("a/one.bag", "b/c/two.bag", "b/three.mcap"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    settings = ("window.lag=1.2,1.5,2", "edges.max_lines=20, 30", "window.updates=2")
    jobs = planned(f"{tmp_path}/**/*.bag", f"{tmp_path}/a/one.bag", settings=settings)
    assert len(jobs) == 12
    assert {Path(job.recording).name for job in jobs} == {"one.bag", "two.bag"}
    assert {(job.config.window.lag, job.config.edges.max_lines) for job in jobs} == {
        (lag, lines) for lag in (1.2, 1.5, 2.0) for lines in (20, 30)
    }
    assert {job.config.window.updates for job in jobs} == {2}
    # A run is named for what it differs in.
    assert jobs[0].settings == ("window.lag=1.2", "edges.max_lines=20")
    assert jobs[0].name.startswith("one_window.lag=1.2_edges.max_lines=20-")
    assert len({job.name for job in jobs}) == 12
    assert [job.name for job in jobs] == [
        job.name for job in planned(f"{tmp_path}/**/*.bag", settings=settings)
    ]


def test_files_go_with_their_recordings(tmp_path):
    (tmp_path / "one.bag").touch()
    (job,) = planned(
        f"{tmp_path}/*.bag",
        inputs=InputOptions(("{folder}/calib.yaml",), ground_truth="{folder}/{stem}.tum"),
    )
    assert job.inputs.calibration_files == (f"{tmp_path}/calib.yaml",)
    assert job.inputs.ground_truth == f"{tmp_path}/one.tum"
    (job,) = planned("s3://bucket/a/one.bag", inputs=calibrated("{folder}/{stem}.yaml"))
    assert job.inputs.calibration_files == ("s3://bucket/a/one.yaml",)


def test_simulations_have_seeds():
    assert [job.seed for job in planned(SMALL, seeds=3)] == [0, 1, 2]
    assert planned(SMALL)[0].name.startswith("noncoplanar_cluttered-free_seed0-")


@pytest.mark.parametrize(
    ("patterns", "options", "message"),
    [
        (["nothing/*.bag"], {}, "nothing/"),
        (["pyproject.toml"], {"seeds": 2}, "--seeds: a recording has no randomness"),
        ([SMALL], {"settings": ("window.lag=1.2,high",)}, "'high' is not a number"),
        ([SMALL], {"settings": ("window.lga=1",)}, "window.lga: no such setting"),
        (["sim:room"], {}, "write sim:SCENE:MOTION"),
        (["sim:room:free?speed=3"], {}, r"speed=3: options are rate, duration"),
        (["sim:room:free?rate=fast"], {}, "rate=fast: options are rate, duration"),
    ],
)
def test_a_batch_that_makes_no_sense_is_refused_before_it_begins(patterns, options, message):
    with pytest.raises(RuledgraphError, match=re.escape(message)):
        planned(*patterns, **options)


def summary(ate: float) -> dict:
    accuracy = {"ate_rmse": ate, "rpe_rmse": None}
    return {
        "frames": 60,
        "frames_estimated": 40,
        "recoveries": [],
        "warnings": ["w"],
        "real_time_factor": 2.0,
        "accuracy": {"trajectory_live": accuracy, "trajectory": accuracy},
    }


def test_what_is_kept_and_the_tables(tmp_path):
    jobs = planned(SMALL, seeds=4)
    store = Store(tmp_path)
    assert [store.error(job) for job in jobs] == [None] * 4
    for job, ate in zip(jobs, (0.004, 0.001, 0.002), strict=False):
        files = {"summary.json": json.dumps(summary(ate)).encode(), "lines.csv": b"line"}
        store.put(job, Outcome("", summary(ate), files))
    store.put(jobs[3], Outcome("it broke"))
    again = Store(tmp_path)
    assert [again.error(job) for job in jobs] == ["", "", "", "it broke"]
    assert (tmp_path / jobs[0].name / "lines.csv").read_bytes() == b"line"
    table, text, page = again.write_tables(jobs)
    assert "4 runs compared" in page.read_text()
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["ate_live_mm"] for row in rows] == ["4.00", "1.00", "2.00", ""]
    assert [row["error"] for row in rows] == ["", "", "", "it broke"]
    assert (
        f"| {SMALL} | defaults | 4 | 1 | 2.0 (1.0 to 4.0) | 2.0 (1.0 to 4.0) |" in text.read_text()
    )
    assert f"- `{jobs[3].name}`: it broke" in text.read_text()


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "photos").mkdir()
    with pytest.raises(RuledgraphError, match="holds photos, which is no batch's"):
        Store(tmp_path)


def test_a_run_that_fails_says_why(tmp_path):
    (tmp_path / "broken.bag").write_bytes(b"#ROSBAG V2.0\nand then nothing")
    (job,) = planned(str(tmp_path / "broken.bag"), inputs=calibrated("calib.yaml"))
    outcome = run_job(job)
    assert "broken.bag" in outcome.error
    assert "\n" not in outcome.error
    assert outcome.files == {}


def test_a_recording_by_its_url(tmp_path):
    pytest.importorskip("fsspec")
    (tmp_path / "empty.bag").touch()
    (job,) = planned(f"file://{tmp_path}/empty.bag", inputs=calibrated("calib.yaml"))
    assert run_job(job).error.endswith("empty.bag is empty")
    (job,) = planned(f"file://{tmp_path}/missing.bag", inputs=calibrated("calib.yaml"))
    assert "missing.bag: cannot be fetched" in run_job(job).error


def test_a_batch_goes_on_where_it_was(tmp_path, monkeypatch):
    (tmp_path / "broken.bag").touch()
    ran: list[Job] = []

    def run_here(jobs, done, **_):
        for job in jobs:
            ran.append(job)
            done(job, run_job(job))

    monkeypatch.setattr(batch_command, "run_all", run_here)
    monkeypatch.chdir(tmp_path)
    command = ["batch", SMALL, "broken.bag", "--seeds", "2", "--output", "out"]
    command += ["--calibration", "c.yaml"]
    first = CliRunner().invoke(main, command)
    assert first.exit_code == 1
    assert "2 of 3 runs are complete, 1 failed" in first.output
    assert "broken.bag is empty" in first.output
    assert [line[:4] for line in first.output.splitlines() if line[1:2] == "/"] == [
        "1/3 ",
        "2/3 ",
        "3/3 ",
    ]
    for job in ran[:2]:
        assert len(read_tum(tmp_path / "out" / job.name / "trajectory.tum")) > 20
    assert (tmp_path / "out" / "table.md").read_text().count("\n|") == 4
    second = CliRunner().invoke(main, command)
    assert "2 of 3 runs are there already" in second.output
    # The one that failed is tried again; --force does all again.
    assert [job.recording for job in ran[3:]] == ["broken.bag"]
    CliRunner().invoke(main, [*command, "--force"])
    assert len(ran) == 7


def test_a_batch_on_this_machines_cores(tmp_path):
    pytest.importorskip("distributed")
    (tmp_path / "broken.bag").touch()
    result = subprocess.run(
        [sys.executable, "-m", "ruledgraph", "batch", SMALL, "broken.bag", "--jobs", "1"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 1
    assert "1 of 2 runs are complete, 1 failed" in result.stdout, result.stderr
    assert "Traceback" not in result.stderr
    assert (tmp_path / "results" / "batch" / "table.csv").read_text().count("\n") == 3


def test_without_dask_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = CliRunner().invoke(main, ["batch", SMALL, "--output", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "pip install distributed" in result.output


def test_a_worker_dies_and_all_results_are_there(tmp_path):
    pytest.importorskip("distributed")
    from ruledgraph.app.batch.cluster import run_all

    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    plain = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = [*dask, "scheduler", "--port", "0", "--host", "127.0.0.1", *plain]
    worker = [*dask, "worker", "--nthreads", "1", "--no-nanny", *plain]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    processes = [subprocess.Popen(command, **quiet) for command in (scheduler, worker, worker)]
    try:
        stop = time.monotonic() + 30.0
        while not file.exists() and time.monotonic() < stop:
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        jobs = planned(SMALL, seeds=4)
        outcomes: dict[str, Outcome] = {}

        def done(job, outcome):
            if not outcomes:
                # Its next run is on its way.
                os.kill(processes[1].pid, signal.SIGKILL)
            outcomes[job.name] = outcome

        run_all(jobs, done, workers=1, scheduler=address)
        assert processes[1].wait(5.0) == -signal.SIGKILL
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert outcomes.keys() == {job.name for job in jobs}
    for outcome in outcomes.values():
        assert outcome.error == ""
        assert outcome.summary["ended"] == "complete"
        assert outcome.summary["accuracy"]["trajectory"]["ate_rmse"] < 0.02
        assert {"trajectory.tum", "summary.json", "lines.csv"} <= outcome.files.keys()
