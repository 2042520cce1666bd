# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations written as Kalibr's files, and read back."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
import yaml

from calibration_files import CAM0, CAMERA0, CAMERA1, IMU, INFO_CAMERA, assert_same
from ruledgraph.calibration import CalibrationError, read_calibration, write_kalibr
from ruledgraph.calibration.imu_noise import D435I_LIKE, ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.errors import RuledgraphError


@pytest.mark.parametrize(
    "camera", [CAMERA0, CAMERA1, INFO_CAMERA], ids=lambda camera: camera.distortion
)
def test_written_files_read_back_the_same(tmp_path, camera):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        calibration = Calibration(
            replace(camera, fx=float(rng.uniform(300, 600)), cx=float(rng.uniform(100, 300))),
            gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3)),
            ImuNoise(*(float(x) for x in 10.0 ** rng.integers(-6, 0, 4))),
            float(rng.normal()) * 1e-3,
            *(("/camera/image", "/imu") if seed % 2 else (None, None)),
        )
        path = tmp_path / f"{seed}.yaml"
        write_kalibr(calibration, path)
        assert_same(read_calibration(path), calibration)


def test_written_numbers_are_numbers_to_yaml_1_1(tmp_path):
    calibration = Calibration(CAMERA0, gtsam.Pose3(), ImuNoise(1e-5, 2e-3, 1e-7, 1e-4))
    write_kalibr(calibration, tmp_path / "calib.yaml")
    read = yaml.safe_load((tmp_path / "calib.yaml").read_text())
    assert read["cam0"]["distortion_coeffs"] == list(CAMERA0.coefficients)
    assert read["imu0"]["gyroscope_noise_density"] == 1e-5
    assert read["cam0"]["T_cam_imu"] == np.eye(4).tolist()


def test_writing_does_not_replace_a_file(file, tmp_path):
    path = file(CAM0)
    calibration = Calibration(CAMERA0, gtsam.Pose3(), D435I_LIKE)
    with pytest.raises(CalibrationError) as error:
        write_kalibr(calibration, path)
    assert str(error.value) == f"{path}: exists already, choose another name"
    assert path.read_text(encoding="utf-8") == CAM0
    with pytest.raises(CalibrationError, match="cannot be written: No such file"):
        write_kalibr(calibration, tmp_path / "no" / "folder.yaml")


def test_a_file_can_say_that_the_time_offset_is_exact(tmp_path):
    (tmp_path / "imu.yaml").write_text(IMU)
    plain, exact, wrong = (tmp_path / f"{name}.yaml" for name in ("plain", "exact", "wrong"))
    plain.write_text(CAM0)
    exact.write_text(CAM0 + "  timeshift_exact: true\n")
    wrong.write_text(CAM0 + "  timeshift_exact: maybe\n")
    assert not read_calibration(plain, tmp_path / "imu.yaml").time_offset_exact
    calibration = read_calibration(exact, tmp_path / "imu.yaml")
    assert calibration.time_offset_exact
    write_kalibr(calibration, tmp_path / "written.yaml")
    assert read_calibration(tmp_path / "written.yaml").time_offset_exact
    with pytest.raises(CalibrationError, match="cam0/timeshift_exact = 'maybe' must be true or"):
        read_calibration(wrong, tmp_path / "imu.yaml")


def test_line_delay_is_read_and_written(tmp_path):
    """Kalibr's seconds per row, none of a global shutter; without it nothing is known of it."""
    (tmp_path / "imu.yaml").write_text(IMU)
    (tmp_path / "rolling.yaml").write_text(CAM0 + "  line_delay: 3.0e-05\n")
    rolling = read_calibration(tmp_path / "rolling.yaml", tmp_path / "imu.yaml")
    assert rolling.line_delay == 3e-5
    assert rolling.readout == pytest.approx(479 * 3e-5, rel=1e-12)
    write_kalibr(rolling, tmp_path / "written.yaml")
    assert_same(read_calibration(tmp_path / "written.yaml"), rolling)
    write_kalibr(rolling.with_readout(0.0), tmp_path / "global.yaml")
    assert read_calibration(tmp_path / "global.yaml").line_delay == 0.0
    write_kalibr(replace(rolling, line_delay=None), tmp_path / "unknown.yaml")
    assert "line_delay" not in (tmp_path / "unknown.yaml").read_text()
    unknown = read_calibration(tmp_path / "unknown.yaml")
    assert unknown.line_delay is None
    assert unknown.readout == unknown.middle_row_delay == 0.0


def test_a_stamp_is_of_the_first_row_or_of_the_middle_one():
    rolling = Calibration(CAMERA0, gtsam.Pose3(), D435I_LIKE).with_readout(0.02)
    assert rolling.middle_row_delay == pytest.approx(0.01)
    assert replace(rolling, stamp_at_middle_row=True).middle_row_delay == 0.0


@pytest.mark.parametrize("wrong", [-1e-9, np.nan, np.inf])
def test_a_readout_is_a_time(wrong):
    calibration = Calibration(CAMERA0, gtsam.Pose3(), D435I_LIKE)
    with pytest.raises(RuledgraphError, match=r"line_delay = .* s is negative or not finite"):
        calibration.with_readout(wrong)
