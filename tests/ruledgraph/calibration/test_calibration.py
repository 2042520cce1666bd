# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations read from the files of Kalibr, of EuRoC, and from ROS's CameraInfo."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import gtsam
import numpy as np
import pytest

from calibration_files import (
    ASL_CAMERA,
    ASL_IMU,
    BODY_T_CAM0,
    CAM0,
    CAM1,
    CAMERA0,
    CAMERA1,
    CAMERA_INFO,
    IMU,
    IMU0,
    INFO_CAMERA,
    NOISE_FIGURES,
    assert_pose,
    assert_same,
)
from ruledgraph.calibration import (
    TYPICAL_IMU_NOISE,
    CalibrationError,
    camera_from_info,
    read_calibration,
)
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE, D435I_LIKE
from ruledgraph.calibration.rig import Calibration

EUROC = Path(__file__).parents[3] / "../shared/data/euroc_MH_01_30s/MH_01_30s.calib.yaml"


def moved(x: float) -> np.ndarray:
    matrix = BODY_T_CAM0.copy()
    matrix[0, 3] += x
    return matrix


# Kalibr


@pytest.mark.parametrize("imu", [IMU, IMU0], ids=["imu.yaml", "imu0"])
def test_kalibr_camchain_and_imu_file(file, imu):
    calibration = read_calibration(file(CAM0), file(imu, "imu.yaml"))
    assert_pose(calibration.body_T_cam, BODY_T_CAM0)
    assert calibration == Calibration(
        CAMERA0, calibration.body_T_cam, NOISE_FIGURES, -0.00123, "/cam0/image_raw", "/imu0"
    )


def test_one_file_and_two_give_the_same(file):
    one = read_calibration(str(file(CAM0 + IMU0)))
    assert_same(one, read_calibration(file(IMU, "imu.yaml"), file(CAM0)))


def test_a_camera_down_the_chain(file):
    path = file(CAM0 + CAM1 + CAM1.replace("cam1", "cam2").replace("-0.11", "-0.2") + IMU0)
    # A point 0.11 further along the camera's x, the body's -y, is the next camera's origin.
    for name, y in (("cam1", 0.2 - 0.11), ("cam2", 0.2 - 0.31)):
        calibration = read_calibration(path, camera=name)
        assert calibration.camera == CAMERA1
        assert calibration.time_offset == 0.0
        wanted = BODY_T_CAM0.copy()
        wanted[1, 3] = y
        assert_pose(calibration.body_T_cam, wanted)


def test_a_pose_of_its_own_comes_before_the_chain(file):
    own = CAM0.replace("cam0", "cam1").replace("-0.1]", "-0.4]")
    path = file(CAM0 + own + re.search(r"  T_cn_cnm1:\n(  - .*\n){4}", CAM1)[0] + IMU0)
    assert_pose(read_calibration(path, camera="cam1").body_T_cam, moved(0.3))


def test_pose_of_the_camera_on_the_imu(file):
    rows = "".join(f"  - {row.tolist()}\n" for row in BODY_T_CAM0)
    text = re.sub(r"  T_cam_imu:\n(  - .*\n){4}", f"  T_imu_cam:\n{rows}", CAM0)
    assert_pose(read_calibration(file("%YAML:1.0\n\n" + text + IMU0)).body_T_cam, BODY_T_CAM0)


def test_six_digits_become_a_rotation(file):
    tilted = gtsam.Rot3.RzRyRx(0.1, -0.2, 0.3).matrix()
    rows = "".join(
        f"  - [{', '.join(f'{x:.6f}' for x in row)}, {0.1 * i}]\n" for i, row in enumerate(tilted)
    )
    text = re.sub(r"  T_cam_imu:\n(  - .*\n){3}", f"  T_cam_imu:\n{rows}", CAM0)
    R = read_calibration(file(text + IMU0)).body_T_cam.rotation().matrix()
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(R, tilted.T, atol=1e-6)


@pytest.mark.skipif(not EUROC.exists(), reason="needs the recorded EuRoC calibration")
def test_recorded_euroc_calibration():
    calibration = read_calibration(EUROC)
    assert calibration.imu_noise == ADIS16448_LIKE
    assert calibration.camera.coefficients == (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
    # As T_BS in the dataset's cam0/sensor.yaml.
    position = [-0.0216401454975, -0.064676986768, 0.00981073058949]
    np.testing.assert_allclose(calibration.body_T_cam.translation(), position, atol=1e-12)


# several cameras


def test_several_cameras_must_be_chosen_from(file):
    path = file(CAM0 + CAM1 + IMU0)
    flags = "--camera cam0 (/cam0/image_raw), --camera cam1 (/cam1/image_raw)"
    with pytest.raises(CalibrationError) as error:
        read_calibration(path)
    assert str(error.value) == f"{path}: 2 cameras, choose one: {flags}"
    with pytest.raises(CalibrationError) as error:
        read_calibration(path, camera="cam2")
    assert str(error.value) == f"{path}: no camera cam2, but {flags}"
    with pytest.raises(CalibrationError, match="choose one"):
        read_calibration(path, image_topic="/other/image_raw")


@pytest.mark.parametrize("topic", ["/cam1/image_raw", "cam1/image_raw/compressed"])
def test_the_image_topic_chooses_the_camera(file, topic):
    path = file(CAM0 + CAM1 + IMU0)
    assert read_calibration(path, image_topic=topic).camera == CAMERA1
    assert read_calibration(path, image_topic=topic, camera="cam0").camera == CAMERA0


def test_the_only_camera_needs_no_matching_topic(file):
    assert read_calibration(file(CAM0 + IMU0), image_topic="/other").camera == CAMERA0


def test_a_camera_that_is_not_chosen_may_be_unsupported(file):
    path = file(CAM0 + CAM1.replace("pinhole", "omni") + IMU0)
    assert read_calibration(path, camera="cam0").camera == CAMERA0


# EuRoC


@pytest.fixture
def asl_folder(file):
    for name, x in (("cam0", 0.1), ("cam1", 0.6)):
        file(ASL_CAMERA.format(name=name, x=x), f"mav0/{name}/sensor.yaml")
    return file(ASL_IMU.format(x=0.0), "mav0/imu0/sensor.yaml").parents[2]


def test_euroc_folder(asl_folder):
    for folder in (asl_folder, asl_folder / "mav0"):
        calibration = read_calibration(folder, camera="cam0")
        assert_pose(calibration.body_T_cam, BODY_T_CAM0)
        assert calibration == Calibration(CAMERA0, calibration.body_T_cam, NOISE_FIGURES)
    second = read_calibration(asl_folder, image_topic="/cam1/image_raw")
    assert_pose(second.body_T_cam, moved(0.5))
    with pytest.raises(CalibrationError, match="choose one: --camera cam0, --camera cam1"):
        read_calibration(asl_folder)


def test_euroc_files_with_an_imu_away_from_the_body(file):
    camera = file(ASL_CAMERA.format(name="cam0", x=0.1), "cam0/sensor.yaml")
    imu = file(ASL_IMU.format(x=0.25), "imu0/sensor.yaml")
    assert_pose(read_calibration(camera, imu).body_T_cam, moved(-0.25))


def test_a_folder_without_cameras(tmp_path):
    with pytest.raises(CalibrationError, match=r"no cam0/sensor\.yaml in this folder"):
        read_calibration(tmp_path)


# CameraInfo


@pytest.mark.parametrize(
    ("model", "coefficients", "wanted"),
    [
        ("plumb_bob", [0.1, -0.2, 0.001, 0.002, 0.03], "radtan"),
        ("plumb_bob", [0.0, 0.0, 0.0, 0.0, 0.0], "radtan"),
        ("rational_polynomial", [0.1, -0.2, 0.001, 0.002, 0.03, 0.0, 0.0, 0.0], "radtan"),
        ("equidistant", [0.1, -0.2, 0.001, 0.002], "equidistant"),
        ("plumb_bob", [], "none"),
    ],
)
def test_camera_info(file, model, coefficients, wanted):
    text = CAMERA_INFO.format(model=model, n=len(coefficients), coefficients=coefficients)
    camera = replace(INFO_CAMERA, distortion=wanted, coefficients=tuple(coefficients[:5]))
    for mount in (CAM0, re.search(r"cam0:\n  T_cam_imu:\n(  - .*\n){4}", CAM0)[0]):
        calibration = read_calibration(file(text, "info.yaml"), file(mount + IMU0))
        assert calibration.camera == camera
        assert_pose(calibration.body_T_cam, BODY_T_CAM0)
    common = {"width": 640, "height": 480, "distortion_model": model}
    K, D = np.array([610.5, 0, 322.25, 0, 611.5, 239.5, 0, 0, 1]), np.array(coefficients)
    assert camera_from_info(SimpleNamespace(**common, K=K, D=D)) == camera
    assert camera_from_info(SimpleNamespace(**common, k=K, d=D)) == camera


def test_echoed_camera_info(file):
    echoed = "\n".join(
        ["header:", "  frame_id: cam", "height: 480", "width: 640", "distortion_model: plumb_bob"]
        + ["d: [0.1, 0.2, 0.0, 0.0, 0.0]", "k:"]
        + [f"- {x}" for x in (610.5, 0.0, 322.25, 0.0, 611.5, 239.5, 0.0, 0.0, 1.0)]
        + ["---", ""]
    )
    camera = read_calibration(file(echoed, "info.yaml"), file(CAM0 + IMU0)).camera
    assert camera == replace(
        INFO_CAMERA, distortion="radtan", coefficients=(0.1, 0.2, 0.0, 0.0, 0.0)
    )


def test_camera_info_alone_has_no_pose(file):
    path = file(CAMERA_INFO.format(model="plumb_bob", n=0, coefficients=[]))
    with pytest.raises(CalibrationError) as error:
        read_calibration(path)
    assert str(error.value) == (
        f"{path}: T_cam_imu is missing, the transform from IMU to camera coordinates; add a file "
        "with cam0/T_cam_imu, such as Kalibr's camchain-imucam.yaml"
    )


def test_messages_that_describe_no_usable_camera():
    message = SimpleNamespace(width=640, height=480, distortion_model="", k=np.zeros(9), d=[])
    with pytest.raises(CalibrationError, match="CameraInfo message: K has focal lengths 0, 0"):
        camera_from_info(message)
    message.k = [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0]
    message.distortion_model, message.d = "rational_polynomial", [0.1] * 8
    with pytest.raises(CalibrationError, match="D uses the rational model"):
        camera_from_info(message)
    message.p = np.zeros(12)
    with pytest.raises(CalibrationError, match="CameraInfo message: P has focal lengths 0, 0"):
        camera_from_info(message, rectified=True)


def test_what_distorts_a_camera_does_not_distort_its_rectified_images():
    projection = [600.0, 0.0, 320.0, 0.0, 0.0, 600.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    message = SimpleNamespace(width=640, height=480, distortion_model="unheard_of", p=projection)
    assert camera_from_info(message, rectified=True) == CameraModel(
        640, 480, 600.0, 600.0, 320.0, 240.0
    )


# overrides


def test_what_the_caller_knows_comes_before_the_files(file):
    camera = CameraModel(640, 480, 600.0, 600.0, 320.0, 240.0)
    path = file(CAM0.replace("458.5", "oops"))
    calibration = read_calibration(path, camera_model=camera, imu_noise=D435I_LIKE)
    assert (calibration.camera, calibration.imu_noise) == (camera, D435I_LIKE)
    assert TYPICAL_IMU_NOISE["d435i"] == D435I_LIKE
