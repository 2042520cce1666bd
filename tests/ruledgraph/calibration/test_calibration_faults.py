# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Files that are no calibration, or a wrong or damaged one: one line says what is wrong."""

import time

import numpy as np
import pytest

from calibration_files import ASL_CAMERA, ASL_IMU, CAM0, CAM1, CAMERA_INFO, IMU, IMU0
from ruledgraph.calibration import CalibrationError, read_calibration


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
        ("T_cam_imu:", "T_imu_ca:", "cam0/T_cam_imu is missing, the transform from IMU to camera"),
        ("[0.0, -1.0, 0.0, 0.2]", "[0.0, -1.0]", "cam0/T_cam_imu must be 16 numbers, not 14"),
        ("-1.0, 0.3]", "-1.01, 0.3]", "cam0/T_cam_imu has a rotation R with R R^T off the identi"),
        ("[0.0, -1.0, ", "[0.0, 1.0, ", "cam0/T_cam_imu has a mirrored rotation, with determina"),
        ("-1.0, 0.3]", "-1e200, 0.3]", "cam0/T_cam_imu has a rotation with an entry above 1"),
        ("0.2]", "200]", "cam0/T_cam_imu has a translation above 10 m; it must be in metres"),
        ("[0.0, 0.0, 0.0, 1.0]", "[0, 0, 1, 0]", "cam0/T_cam_imu must have 0, 0, 0, 1 as its la"),
        ("-0.00123", "-1230000", "cam0/timeshift_cam_imu = -1.23e+06 is not within -10 to 10"),
        (
            "  timeshift_cam_imu: -0.00123",
            "  line_delay: -1e-5",
            "cam0/line_delay = -1e-05 is not within 0 to 0.001",
        ),
        (
            "  timeshift_cam_imu: -0.00123",
            "  line_delay: 0.02",
            "cam0/line_delay = 0.02 is not within 0 to 0.001",
        ),
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
