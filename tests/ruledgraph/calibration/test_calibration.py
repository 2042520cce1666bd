# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
import re
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import gtsam
import numpy as np
import pytest
import yaml

from ruledgraph.calibration import (
    TYPICAL_IMU_NOISE,
    CalibrationError,
    camera_from_info,
    read_calibration,
    write_kalibr,
)
from ruledgraph.calibration.sensors import (
    ADIS16448_LIKE,
    D435I_LIKE,
    Calibration,
    CameraModel,
    ImuNoise,
)

EUROC = Path(__file__).parents[3] / "../shared/data/euroc_MH_01_30s/MH_01_30s.calib.yaml"

# x of the camera is -y of the body, and so on; the camera sits at (0.1, 0.2, 0.3) of the body.
CAM0 = """\
cam0:
  T_cam_imu:
  - [0.0, -1.0, 0.0, 0.2]
  - [0.0, 0.0, -1.0, 0.3]
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 2e-05]
  distortion_model: radtan
  intrinsics: [458.5, 457.25, 367.0, 248.0]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: -0.00123
"""
CAM1 = """\
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [190.0, 191.0, 255.0, 256.0]
  resolution: [512, 512]
  rostopic: /cam1/image_raw
"""
NOISE = """\
accelerometer_noise_density: 0.002
accelerometer_random_walk: 3e-3
gyroscope_noise_density: 1.6e-04
gyroscope_random_walk: 2e-05
"""
IMU = NOISE + "rostopic: /imu0\nupdate_rate: 200.0\n"
IMU0 = "imu0:\n" + "".join(f"  {line}\n" for line in IMU.splitlines())
NOISE_FIGURES = ImuNoise(1.6e-4, 0.002, 2e-5, 3e-3)
CAMERA0 = CameraModel(752, 480, 458.5, 457.25, 367.0, 248.0, "radtan", (-0.28, 0.07, 0.0002, 2e-05))
CAMERA1 = CameraModel(512, 512, 190.0, 191.0, 255.0, 256.0, "equidistant", (0.01, 0.02, 0.03, 0.04))
BODY_T_CAM0 = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.2], [0, -1, 0, 0.3], [0, 0, 0, 1.0]])

ASL_CAMERA = """\
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor {name} (MT9M034)

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [0.0, 0.0, 1.0, {x},
        -1.0, 0.0, 0.0, 0.2,
        0.0, -1.0, 0.0, 0.3,
        0.0, 0.0, 0.0, 1.0]

# Camera specific definitions.
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.5, 457.25, 367.0, 248.0] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 2e-05]
"""
ASL_IMU = """\
%YAML:1.0
---
sensor_type: imu
T_BS: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [ 1., 0., 0., {x}, 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1. ]
rate_hz: 200
""" + NOISE  # fmt: skip

CAMERA_INFO = """\
image_width: 640
image_height: 480
camera_name: d435i
camera_matrix:
  rows: 3
  cols: 3
  data: [610.5, 0, 322.25, 0, 611.5, 239.5, 0, 0, 1]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {n}
  data: {coefficients}
"""
INFO_CAMERA = CameraModel(640, 480, 610.5, 611.5, 322.25, 239.5)


@pytest.fixture
def file(tmp_path):
    """Writes a text to a new file and returns its path."""

    def write(text: str, name: str = "calib.yaml") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


def assert_pose(pose: gtsam.Pose3, matrix: np.ndarray, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(pose.matrix(), matrix, rtol=0, atol=atol)


def assert_same(read: Calibration, wanted: Calibration) -> None:
    assert_pose(read.body_T_cam, wanted.body_T_cam.matrix())
    assert replace(read, body_T_cam=wanted.body_T_cam) == wanted


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
        f"{path}: T_cam_imu is missing, the camera's pose on the IMU; add a file with "
        "cam0/T_cam_imu, such as Kalibr's camchain-imucam.yaml"
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


# errors


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pinhole", "fov", "cam0/camera_model 'fov' is not supported; calibrate with one of"),
        ("pinhole", "omni", "cam0/intrinsics must be 5 numbers, not 4"),
        ("pinhole", "[1]", "cam0/camera_model must be a word"),
        ("/cam0/image_raw", '"/cam0\\nx"', "cam0/rostopic must be a word"),
        ("radtan", "fov", "cam0/distortion_model 'fov' is not supported; calibrate with radtan"),
        ("radtan", "none", "cam0/distortion_coeffs do not fit: distortion model none takes 0"),
        ("-0.28, ", "", "cam0/distortion_coeffs do not fit: distortion model radtan takes 4 or 5"),
        ("458.5, ", "", "cam0/intrinsics must be 4 numbers, not 3"),
        ("458.5", "4.58", "cam0/intrinsics has focal lengths 4.58, 457.25, implausible for 752 x"),
        ("458.5", "nan", "cam0/intrinsics must be numbers, but one is 'nan'"),
        ("458.5", "[[1]]", "cam0/intrinsics must be numbers, but one is a list or mapping"),
        ("367.0", "3670", "cam0/intrinsics has its principal point 3670, 248 far outside the"),
        ("  intrinsics: [458.5, 457.25, 367.0, 248.0]\n", "", "cam0/intrinsics is missing"),
        ("[752, 480]", "[752.5, 480]", "cam0/resolution = 752.5 x 480 is no image size"),
        ("[752, 480]", "[0, 480]", "cam0/resolution = 0 x 480 is no image size in pixels"),
        ("T_cam_imu:", "T_imu_ca:", "cam0/T_cam_imu is missing, the camera's pose on the IMU"),
        ("[0.0, -1.0, 0.0, 0.2]", "[0.0, -1.0]", "cam0/T_cam_imu must be 16 numbers, not 14"),
        ("-1.0, 0.3]", "-1.01, 0.3]", "cam0/T_cam_imu has a rotation R with R R^T off the identi"),
        ("[0.0, -1.0, ", "[0.0, 1.0, ", "cam0/T_cam_imu has a mirrored rotation, with determina"),
        ("-1.0, 0.3]", "-1e200, 0.3]", "cam0/T_cam_imu has a rotation with an entry above 1"),
        ("0.2]", "200]", "cam0/T_cam_imu has a translation above 10 m; it must be in metres"),
        ("[0.0, 0.0, 0.0, 1.0]", "[0, 0, 1, 0]", "cam0/T_cam_imu must have 0, 0, 0, 1 as its la"),
        ("-0.00123", "-1230000", "cam0/timeshift_cam_imu = -1.23e+06 is not within -10 to 10"),
        ("0.002\n", "-0.002\n", "imu0/accelerometer_noise_density = -0.002 is not within 1e-12 t"),
        ("2e-05\n", "0\n", "imu0/gyroscope_random_walk = 0 is no noise figure, give a positive"),
        ("0.002\n", "1e-300\n", "imu0/accelerometer_noise_density = 1e-300 is not within 1e-12 to"),
        ("1.6e-04\n", "1e-300\n", "imu0/gyroscope_noise_density = 1e-300 is not within 1e-12 to"),
        ("3e-3\n", "1e-300\n", "imu0/accelerometer_random_walk = 1e-300 is not within 1e-12 to"),
        ("2e-05\n", "1e-300\n", "imu0/gyroscope_random_walk = 1e-300 is not within 1e-12 to"),
        ("-0.28", "1e308", "cam0/distortion_coeffs leave 0 of the image's 25 places a viewing"),
        ("2e-05]", "-1e308]", "cam0/distortion_coeffs leave 0 of the image's 25 places a viewing"),
        ("-0.28", "-1e4", "cam0/distortion_coeffs leave 0 of the image's 25 places a viewing"),
        ("gyroscope_random_walk", "gyro_walk", "imu0/gyroscope_random_walk is missing"),
        ("T_cam_imu:", "T_cam_imu: 3\n  x:", "cam0/T_cam_imu must be 16 numbers, not 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(file, old, new, message):
    text = CAM0 + IMU0
    assert old in text
    path = file(text.replace(old, new, 1))
    with pytest.raises(CalibrationError) as error:
        read_calibration(path)
    assert str(error.value).startswith(f"{path}: {message}")


def test_missing_noise_names_what_to_do(file):
    path = file(CAM0)
    with pytest.raises(CalibrationError) as error:
        read_calibration(path)
    assert str(error.value) == (
        f"{path}: no IMU noise densities; add Kalibr's imu.yaml or EuRoC's imu0/sensor.yaml, "
        "or take typical figures: --imu d435i, --imu adis16448"
    )


def test_the_same_sensor_twice(file):
    first, second = file(CAM0 + IMU0), file(CAM0, "camchain.yaml")
    with pytest.raises(CalibrationError) as error:
        read_calibration(first, second)
    assert str(error.value) == f"{second}: cam0 is in {first} too, leave one out"


def test_a_chain_without_its_first_camera(file):
    with pytest.raises(CalibrationError, match="cam1/T_cam_imu is missing"):
        read_calibration(file(CAM1 + IMU0))


BOMB = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 30))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1, 2", ":1: not valid YAML: "),
        ("cam0: {a: 1}\ncam0: {a: 2}", ": not plain YAML: the key 'cam0' occurs twice"),
        ("[" * 99_000, ": not plain YAML: nested deeper than 16 levels"),
        ("a0: &a0 x\n" + BOMB, ": not plain YAML: aliases"),
        ("a: b\n" * 30_000, ": larger than 100 kB, not a calibration"),
        ("%YAML 9.9 9.9\n---\na: 1", ": holds no calibration; give a Kalibr camchain"),
        ("", ": holds no calibration"),
        ("just words", ": holds no calibration"),
        ("cam0: 3", ": cam0 must be a mapping"),
        ("a: \0", ": not plain YAML: "),
    ],
    ids=range(10),
)
def test_text_that_is_no_calibration(file, text, message):
    path = file(text)
    start = time.monotonic()
    with pytest.raises(CalibrationError) as error:
        read_calibration(path)
    assert time.monotonic() - start < 5.0
    assert str(error.value).startswith(f"{path}{message}")
    assert "\n" not in str(error.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CalibrationError, match=r"none\.yaml: cannot be read: No such file"):
        read_calibration(tmp_path / "none.yaml")
    with pytest.raises(CalibrationError, match="no file given"):
        read_calibration()
    path = tmp_path / "image.yaml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(CalibrationError, match=r"image\.yaml: not a text file"):
        read_calibration(path)


# Mostly digits and letters: other bytes seldom get past the parser.
ALPHABET = [bytes([b]) for b in (*range(32, 127), *b"0123456789" * 20, 9, 10, 13, 0, 195, 255)]
ALPHABET += [b"\n  ", b"- ", b": ", b"[", b"1e999", b"*a", b"&a ", b"!!x ", b"---\n", b"\xc2\xb2"]


def mutated(seed: int, text: str) -> bytes:
    """Some bytes replaced, left out or put in."""
    rng = np.random.default_rng(seed)
    data = bytearray(text.encode())
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(data)))
        stop = at + int(rng.choice([0, 1, 1, 10]))
        data[at:stop] = ALPHABET[rng.integers(len(ALPHABET))]
    return bytes(data)


@pytest.mark.parametrize(
    ("text", "others"),
    [
        (CAM0 + IMU0, []),
        (ASL_CAMERA.format(name="cam0", x=0.1), [IMU]),
        (ASL_IMU.format(x=0.1), [CAM0]),
        (CAMERA_INFO.format(model="plumb_bob", n=4, coefficients=[0.1] * 4), [CAM0 + IMU0]),
    ],
    ids=["kalibr", "asl camera", "asl imu", "camera info"],
)
def test_damaged_files_give_a_calibration_or_one_line(file, text, others):
    companions = [file(other, f"other{i}.yaml") for i, other in enumerate(others)]
    path = file(text, "damaged.yaml")
    read_calibration(path, *companions)
    outcomes = {"read": 0, "refused": 0}
    for seed in range(600):
        path.write_bytes(mutated(seed, text))
        try:
            calibration = read_calibration(path, *companions)
        except CalibrationError as error:
            assert "\n" not in str(error)  # noqa: PT017 - both ends are fine
            outcomes["refused"] += 1
        else:
            assert np.isfinite(calibration.body_T_cam.matrix()).all()
            outcomes["read"] += 1
    assert min(outcomes.values()) > 40


# writing


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
