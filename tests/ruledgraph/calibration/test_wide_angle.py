# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Kalibr's wide-angle models against their geometry, their closed-form inverse, and files."""

import numpy as np
import pytest

from numerics import derivative
from recordings import sequence
from ruledgraph.calibration import read_calibration, write_kalibr
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.recording import RecordingError, write_recording
from ruledgraph.simulation import D435I

SIZE = (640, 512)
# Like the calibrations of 1.9 to 3 mm lenses in the models' papers.
OMNI = CameraModel(*SIZE, 640.0, 641.0, 318.0, 255.0, "omni", (1.1,))
OMNI_RADTAN = CameraModel(
    *SIZE, 640.0, 641.0, 318.0, 255.0, "omni", (1.1, -0.15, 0.03, 1e-3, -5e-4)
)
EUCM = CameraModel(*SIZE, 300.0, 301.0, 318.0, 255.0, "eucm", (0.6, 1.1))
DS = CameraModel(*SIZE, 220.0, 221.0, 318.0, 255.0, "ds", (-0.25, 0.56))
CAMERAS = pytest.mark.parametrize(
    "camera", [OMNI, OMNI_RADTAN, EUCM, DS], ids=lambda c: c.distortion
)


def points(count: int = 200) -> np.ndarray:
    """In front of the camera, up to 80 degrees from its axis."""
    rng = np.random.default_rng(0)
    angle, about = rng.uniform(0.0, 1.4, count), rng.uniform(0.0, 2.0 * np.pi, count)
    rays = [np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about), np.cos(angle)]
    return np.stack(rays, axis=1) * rng.uniform(0.5, 20.0, (count, 1))


def on_sensor(camera: CameraModel, m: np.ndarray) -> np.ndarray:
    return m * [camera.fx, camera.fy] + [camera.cx, camera.cy]


def test_omni_is_a_pinhole_behind_the_centre_of_a_sphere():
    P = points()
    sphere = P / np.linalg.norm(P, axis=1, keepdims=True)
    (xi,) = OMNI.coefficients
    m = sphere[:, :2] / (sphere[:, 2:] + xi)
    np.testing.assert_allclose(OMNI.project(P), on_sensor(OMNI, m), rtol=0.0, atol=1e-9)


def test_omni_with_distortion_is_the_same_sphere_seen_through_radtan():
    P = points()
    sphere = P / np.linalg.norm(P, axis=1, keepdims=True)
    xi, *rest = OMNI_RADTAN.coefficients
    lens = CameraModel(*SIZE, 640.0, 641.0, 318.0, 255.0, "radtan", rest)
    expected = lens.project(np.column_stack([sphere[:, :2], sphere[:, 2] + xi]))
    np.testing.assert_allclose(OMNI_RADTAN.project(P), expected, rtol=0.0, atol=1e-9)


def test_eucm_is_an_ellipsoid_seen_from_two_places():
    P = points()
    alpha, beta = EUCM.coefficients
    d = np.sqrt(beta * (P[:, 0] ** 2 + P[:, 1] ** 2) + P[:, 2] ** 2)
    m = P[:, :2] / (alpha * d + (1.0 - alpha) * P[:, 2])[:, None]
    np.testing.assert_allclose(EUCM.project(P), on_sensor(EUCM, m), rtol=0.0, atol=1e-9)


def test_double_sphere_is_one_sphere_after_another():
    P = points()
    xi, alpha = DS.coefficients
    d1 = np.linalg.norm(P, axis=1)
    second = P + np.outer(d1, [0.0, 0.0, xi])
    d2 = np.linalg.norm(second, axis=1)
    m = P[:, :2] / (alpha * d2 + (1.0 - alpha) * second[:, 2])[:, None]
    np.testing.assert_allclose(DS.project(P), on_sensor(DS, m), rtol=0.0, atol=1e-9)


def test_special_cases_are_each_other():
    P = points()
    pinhole = CameraModel(*SIZE, 300.0, 301.0, 318.0, 255.0)
    near = P[P[:, 2] > 0.3 * np.linalg.norm(P, axis=1)]
    for model, parameters in (("omni", (0.0,)), ("eucm", (0.0, 1.0)), ("ds", (0.0, 0.0))):
        same = CameraModel(*SIZE, 300.0, 301.0, 318.0, 255.0, model, parameters)
        np.testing.assert_allclose(same.project(near), pinhole.project(near), rtol=1e-12)
    # The unified model: EUCM with beta 1, alpha = xi / (1 + xi), and its focal length smaller.
    xi = OMNI.coefficients[0]
    unified = CameraModel(
        *SIZE, 640.0 / (1 + xi), 641.0 / (1 + xi), 318.0, 255.0, "eucm", (xi / (1 + xi), 1.0)
    )
    np.testing.assert_allclose(unified.project(P), OMNI.project(P), rtol=1e-12)


@CAMERAS
def test_undistort_inverts_distort(camera):
    P = points()
    np.testing.assert_allclose(
        camera.undistort(camera.project(P)), P[:, :2] / P[:, 2:], rtol=1e-6, atol=1e-8
    )


@CAMERAS
def test_undistort_from_a_guess(camera):
    P = points()
    xy = P[:, :2] / P[:, 2:]
    near = xy * (1.0 + 0.01 * np.sin(np.arange(len(xy))))[:, None]
    found = camera.undistort(camera.project(P), near)
    np.testing.assert_allclose(found, xy, rtol=1e-6, atol=1e-8)


@CAMERAS
def test_the_jacobian(camera):
    for xy in np.random.default_rng(2).uniform(-2.0, 2.0, (30, 2)):
        numerical = derivative(lambda p: camera.distort(p[None]).pixels[0], xy, 1e-4)
        np.testing.assert_allclose(
            camera.distort(xy[None]).jacobian[0], numerical, rtol=1e-6, atol=1e-6
        )


@CAMERAS
def test_the_focal_length_is_that_at_the_centre(camera):
    centre = camera.distort(np.zeros((1, 2)))
    assert camera.focal_length == pytest.approx(0.5 * np.trace(centre.jacobian[0]), rel=1e-12)


def test_pixels_of_rays_from_behind_have_no_normalised_coordinates():
    # 100 degrees from the axis, by the model's own formula.
    angle = np.radians(100.0)
    P = np.array([np.sin(angle), 0.0, np.cos(angle)])
    xi, alpha = DS.coefficients
    second = P + np.array([0.0, 0.0, xi])
    m = P[0] / (alpha * np.linalg.norm(second) + (1.0 - alpha) * second[2])
    assert np.all(np.isnan(DS.undistort([[DS.fx * m + DS.cx, DS.cy]])))


@CAMERAS
def test_kalibrs_file_is_read_back(camera, tmp_path):
    calibration = Calibration(camera, D435I.body_T_cam, D435I_LIKE)
    write_kalibr(calibration, tmp_path / "calib.yaml")
    assert read_calibration(tmp_path / "calib.yaml").camera == camera


@CAMERAS
def test_an_asl_folder_keeps_the_model(camera, tmp_path):
    calibration = Calibration(camera, D435I.body_T_cam, D435I_LIKE)
    write_recording(sequence(0.3), tmp_path / "asl", "asl", calibration=calibration)
    found = read_calibration(tmp_path / "asl").camera
    assert (found.distortion, found.fx, found.cy) == (camera.distortion, camera.fx, camera.cy)
    np.testing.assert_allclose(found.project(points()), camera.project(points()), rtol=1e-12)


def test_ros_has_no_words_for_them(tmp_path):
    calibration = Calibration(DS, D435I.body_T_cam, D435I_LIKE)
    with pytest.raises(RecordingError, match="no CameraInfo for camera model ds"):
        write_recording(sequence(0.3), tmp_path / "a.bag", "rosbag1", calibration=calibration)
    assert not (tmp_path / "a.bag").exists()


KALIBR = """\
cam0:
  T_cam_imu: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  camera_model: MODEL
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [INTRINSICS]
  resolution: [640, 512]
"""


@pytest.mark.parametrize(
    ("model", "intrinsics", "camera"),
    [
        ("omni", "1.1, 640.0, 641.0, 318.0, 255.0", OMNI),
        ("eucm", "0.6, 1.1, 300.0, 301.0, 318.0, 255.0", EUCM),
        ("ds", "-0.25, 0.56, 220.0, 221.0, 318.0, 255.0", DS),
    ],
)
def test_kalibrs_order_of_the_parameters(tmp_path, model, intrinsics, camera):
    text = KALIBR.replace("MODEL", model).replace("INTRINSICS", intrinsics)
    (tmp_path / "calib.yaml").write_text(text)
    assert read_calibration(tmp_path / "calib.yaml", imu_noise=D435I_LIKE).camera == camera


@pytest.mark.parametrize(
    ("model", "intrinsics", "distortion", "message"),
    [
        ("ds", "300.0, 301.0, 318.0, 255.0", "none", "must be 6 numbers, not 4"),
        ("ds", "3.0, 0.5, 300, 301, 318, 255", "none", "xi lies between -1 and 1"),
        ("eucm", "1.6, 1.1, 300, 301, 318, 255", "none", "alpha lies within 0 to 1"),
        ("omni", "-1.1, 640, 641, 318, 255", "none", "is not within 0 to 10"),
        ("omni", "1.1, 6.4, 641, 318, 255", "none", "has focal lengths"),
        ("omni", "1.1, 640, 641, 318, 255", "equidistant", "does not go with camera_model omni"),
    ],
)
def test_parameters_that_make_no_sense(tmp_path, model, intrinsics, distortion, message):
    text = KALIBR.replace("MODEL", model).replace("INTRINSICS", intrinsics)
    if distortion != "none":
        text = text.replace("none", distortion).replace("[]", "[0.1, 0.1, 0.1, 0.1]")
    (tmp_path / "calib.yaml").write_text(text)
    with pytest.raises(RuledgraphError, match=message):
        read_calibration(tmp_path / "calib.yaml", imu_noise=D435I_LIKE)
