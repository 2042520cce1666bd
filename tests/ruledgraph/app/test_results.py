# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What stands under which header of the tables of a run."""

import csv
from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest

from ruledgraph.app.results import Results
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.settings import load_config

# Each number once, so that no column can stand for another.
SIGMAS = {
    "sigma_rotation": [0.11, 0.12, 0.13],
    "sigma_position": [0.21, 0.22, 0.23],
    "sigma_velocity": [0.31, 0.32, 0.33],
    "sigma_accelerometer_bias": [0.41, 0.42, 0.43],
    "sigma_gyroscope_bias": [0.51, 0.52, 0.53],
}


def squared(*names: str) -> np.ndarray:
    return np.diag(np.square(np.concatenate([SIGMAS[name] for name in names])))


def estimate(stamp: int = 1_500_000_000, at_state: bool = True) -> Estimate:
    return Estimate(
        stamp=stamp,
        world_T_body=gtsam.Pose3(gtsam.Rot3.Ry(np.pi / 2), np.array([1.0, 2.0, 3.0])),
        velocity=np.array([4.0, 5.0, 6.0]),
        # GTSAM: accelerometer first.
        bias=gtsam.imuBias.ConstantBias(np.array([0.7, 0.8, 0.9]), np.array([0.07, 0.08, 0.09])),
        covariances=(
            squared("sigma_rotation", "sigma_position"),
            squared("sigma_velocity"),
            squared("sigma_accelerometer_bias", "sigma_gyroscope_bias"),
        ),
        lines=17,
        status="still",
        at_state=at_state,
        segment=3,
        time_offset=TimeOffset(0.004, 0.0005),
    )


def line() -> LineEstimate:
    covariance = np.arange(36.0).reshape(6, 6)
    return LineEstimate(
        id=8,
        ends=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        joint_covariance=covariance + covariance.T,
        first_stamp=1_000_000_000,
        last_stamp=2_000_000_000,
        points=321,
        segment=2,
    )


def table(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture
def folder(tmp_path) -> Path:
    config = load_config(None, ["imu.gravity=9.80665"])
    with Results(tmp_path / "run", config) as results:
        results.write([estimate(), estimate(1_600_000_000, at_state=False)], [], [line()])
    return tmp_path / "run"


def test_columns_of_the_states(folder):
    (row,) = table(folder / "states.csv")  # of states alone
    vectors = {
        "velocity": [4.0, 5.0, 6.0],
        "accelerometer_bias": [0.7, 0.8, 0.9],
        "gyroscope_bias": [0.07, 0.08, 0.09],
        # Body x points down, and its z is the world's x.
        "gravity_in_body": [9.80665, 0.0, 0.0],
        **SIGMAS,
    }
    for name, expected in vectors.items():
        found = [float(row[f"{name}_{axis}"]) for axis in "xyz"]
        np.testing.assert_allclose(found, expected, atol=1e-9)
    assert (row["stamp"], row["lines"], row["status"], row["segment"]) == (
        *("1.500000000", "17", "still", "3"),
    )
    assert (float(row["time_offset"]), float(row["sigma_time_offset"])) == (0.004, 0.0005)


def test_each_live_frame_has_its_status(folder):
    assert table(folder / "live_frames.csv") == [
        {"stamp": stamp, "lines": "17", "status": "still", "segment": "3"}
        for stamp in ("1.500000000", "1.600000000")
    ]


def test_columns_of_the_lines(folder):
    (row,) = table(folder / "lines.csv")
    expected = line()
    for end in (1, 2):
        found = [float(row[f"{axis}{end}"]) for axis in "xyz"]
        np.testing.assert_array_equal(found, expected.ends[end - 1])
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            name = f"covariance{end}_{'xyz'[i]}{'xyz'[j]}"
            assert float(row[name]) == expected.covariance[end - 1, i, j]
    assert (row["line"], row["points"]) == ("8", "321")
    assert (row["sightings"], row["segment"]) == ("1", "2")
    assert (row["first_seen"], row["last_seen"]) == ("1.000000000", "2.000000000")


def test_the_files_of_lines_hold_the_map_and_until_the_end_what_was_seen(tmp_path):
    folder = tmp_path / "run"
    known = replace(line(), joint_covariance=1e-6 * np.eye(6))
    later = replace(known, id=9, first_stamp=3_000_000_000, last_stamp=4_000_000_000)
    with Results(folder, Config()) as results:
        results.write([], [], [known])
        results.write([], [], [later])
        assert [row["line"] for row in table(folder / "lines.csv")] == ["8", "9"]
    (row,) = table(folder / "lines.csv")
    assert (row["line"], row["sightings"], row["points"]) == ("8", "2", "642")
    assert (row["first_seen"], row["last_seen"]) == ("1.000000000", "4.000000000")
    assert len(results.lines) == 1
    assert "element edge 1" in (folder / "lines.ply").read_text()
    assert (folder / "lines.obj").read_text().splitlines()[-1] == "l 1 2"
