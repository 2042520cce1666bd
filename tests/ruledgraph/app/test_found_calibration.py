# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a run has found, as a file."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ruledgraph.app.found_calibration import calibration_summary, write_found_calibration
from ruledgraph.calibration import read_calibration
from ruledgraph.odometry import Odometry
from small_runs import smooth
from small_simulation import SMALL, write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("found calibration")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    write_small_recording(folder)
    return folder


def test_a_readout_that_was_found_is_written_with_the_first_rows_offset(tmp_path):
    """While running the stamps were those of the middle rows."""
    odometry = Odometry(replace(SMALL, line_delay=None, time_offset=0.03))
    write_found_calibration(odometry, tmp_path / "none.yaml")
    assert "line_delay" not in (tmp_path / "none.yaml").read_text()
    assert "readout_s" not in calibration_summary(odometry)
    odometry.online_calibration.set_readout(0.02)
    write_found_calibration(odometry, tmp_path / "found.yaml")
    found = read_calibration(tmp_path / "found.yaml")
    assert found.readout == pytest.approx(0.02)
    assert found.time_offset == pytest.approx(0.03 - 0.01)
    assert found.time_offset + found.middle_row_delay == pytest.approx(0.03)


def test_the_calibration_as_found_can_be_given_to_the_next_run(recording, tmp_path):
    arguments = ("--calibration", recording / "calib.yaml", "--duration", 2.5)
    result = smooth(recording / "small.bag", *arguments, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found, given = (
        read_calibration(path)
        for path in (tmp_path / "out" / "calibration.yaml", recording / "calib.yaml")
    )
    np.testing.assert_allclose(
        found.body_T_cam.inverse().matrix(), summary["extrinsics"]["T_cam_imu"], atol=1e-12
    )
    assert found.time_offset == summary["time_offset"]["s"]
    turn = given.body_T_cam.rotation().between(found.body_T_cam.rotation()).axisAngle()[1]
    assert np.degrees(turn) == pytest.approx(summary["extrinsics"]["rotation_deg"], abs=1e-6)
    # The simulator's is exact: what was found lies within what is said of it.
    assert np.degrees(turn) < 3.0 * summary["extrinsics"]["sigma_rotation_deg"] < 3.0
    ratio, sigma = (summary["focal_length"][name] for name in ("ratio", "sigma_ratio"))
    assert found.camera.fx == pytest.approx(ratio * given.camera.fx, rel=1e-12)
    assert found.camera.fy == pytest.approx(ratio * given.camera.fy, rel=1e-12)
    assert abs(ratio - 1.0) < 3.0 * sigma < 0.03
    assert found.imu_noise == given.imu_noise


def test_the_camera_can_be_held(recording, tmp_path):
    arguments = ("--calibration", recording / "calib.yaml", "--duration", 1.0)
    held = ("--set", "extrinsics.estimate=false", "--set", "intrinsics.estimate=false")
    result = smooth(recording / "small.bag", *arguments, *held, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "Extrinsics   as given, not estimated" in result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["extrinsics"] == summary["focal_length"] == {"estimated": False}
    assert "Focal length as given, not estimated" in result.output
    found, given = (
        read_calibration(path)
        for path in (tmp_path / "out" / "calibration.yaml", recording / "calib.yaml")
    )
    assert found.camera == given.camera
