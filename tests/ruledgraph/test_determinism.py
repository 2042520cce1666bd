# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The same input gives the same bytes, in processes of their own with other hash seeds."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("determinism")

# What a summary holds of the clock on the wall.
CLOCK = {"wall_s", "real_time_factor", "stages"}


def run(folder: Path, seed: int, *arguments: object) -> None:
    subprocess.run(
        [sys.executable, "-m", "ruledgraph", *map(str, arguments)],
        cwd=folder,
        env=os.environ | {"PYTHONHASHSEED": str(seed)},
        capture_output=True,
        timeout=300,
        check=True,
    )


@pytest.fixture(scope="module")
def twice(tmp_path_factory) -> tuple[Path, Path]:
    """A recording simulated, smoothed, exported and looked at, two times."""
    folders = tmp_path_factory.mktemp("one"), tmp_path_factory.mktemp("two")
    with ThreadPoolExecutor() as pool:
        list(pool.map(everything, folders, (1, 2)))
    return folders


def everything(folder: Path, seed: int) -> None:
    simulated = ("--resolution", "320x240", "--rate", "30", "--duration", "2")
    run(folder, seed, "simulate", "noncoplanar_cluttered", "free", "a.bag", *simulated)
    calibration = ("--calibration", "a.calib.yaml")
    truth = ("--ground-truth", "a.gt.tum")
    run(folder, seed, "smooth", "a.bag", *calibration, *truth, "--output", "run")
    run(folder, seed, "export", "a.bag", "a_euroc", "--format", "asl")
    run(folder, seed, "info", "a.bag", *calibration, "--plots", "timing")


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def without_clock(text: bytes) -> dict[str, Any]:
    return {key: value for key, value in json.loads(text).items() if key not in CLOCK}


def test_the_same_input_gives_the_same_bytes(twice):
    first, second = (files(folder) for folder in twice)
    assert first.keys() == second.keys()
    different = {name for name in first if first[name] != second[name]}
    assert different <= {"run/summary.json"}
    assert without_clock(first["run/summary.json"]) == without_clock(second["run/summary.json"])


def test_they_are_all_there(twice):
    names = set(files(twice[0]))
    assert {"a.bag", "a.gt.tum", "a.calib.yaml", "a.lines.csv"} <= names
    assert {"run/trajectory.tum", "run/states.csv", "run/lines.csv"} <= names
    assert any(name.startswith("a_euroc/mav0/cam0/data/") for name in names)
    assert "timing/timing.png" in names
    summary = json.loads((twice[0] / "run/summary.json").read_text())
    assert summary["frames_estimated"] > 30
    assert summary["lines"] > 3
