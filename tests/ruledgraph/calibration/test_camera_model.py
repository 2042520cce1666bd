# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import cv2
import numpy as np
import pytest

from numerics import derivative
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.errors import RuledgraphError

PINHOLE = CameraModel(640, 480, 610.0, 611.0, 322.0, 239.0)
# EuRoC cam0 and TUM-VI cam0, as their datasets state them.
RADTAN = CameraModel(
    752,
    480,
    458.654,
    457.296,
    367.215,
    248.375,
    "radtan",
    (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
)
FISHEYE = CameraModel(
    512,
    512,
    190.97847715128717,
    190.9733070521226,
    254.93170605935475,
    256.8974428996504,
    "equidistant",
    (0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182),
)
CAMERAS = pytest.mark.parametrize("camera", [PINHOLE, RADTAN, FISHEYE], ids=lambda c: c.distortion)


def pixel_grid(camera: CameraModel) -> np.ndarray:
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 30), np.linspace(0, camera.height - 1, 20))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def opencv_pixels(camera: CameraModel, points: np.ndarray) -> np.ndarray:
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    coefficients = np.array(camera.coefficients or (0.0,) * 4)
    project = cv2.fisheye.projectPoints if camera.distortion == "equidistant" else cv2.projectPoints
    zero = np.zeros((3, 1))
    if camera.distortion == "equidistant":
        pixels, _ = project(points[:, None], zero, zero, K, coefficients)
    else:
        pixels, _ = project(points, zero, zero, K, coefficients)
    return pixels.reshape(-1, 2)


@CAMERAS
def test_undistort_inverts_distort_over_the_whole_image(camera):
    pixels = pixel_grid(camera)
    if camera.distortion == "equidistant":  # the corners look beyond 90 degrees: no such point
        pixels = pixels[np.linalg.norm(pixels - [camera.cx, camera.cy], axis=1) < 1.4 * camera.fx]
    np.testing.assert_allclose(
        camera.distort(camera.undistort(pixels)).pixels, pixels, rtol=0, atol=1e-8
    )


@CAMERAS
def test_project_agrees_with_opencv(camera):
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.7, 0.7, (200, 2)), np.ones(200)]) * 3.0
    np.testing.assert_allclose(
        camera.project(points), opencv_pixels(camera, points), rtol=0, atol=1e-8
    )


@CAMERAS
def test_jacobian_of_the_distortion(camera):
    for xy in np.random.default_rng(2).uniform(-0.6, 0.6, (30, 2)):
        numerical = derivative(lambda p: camera.distort(p[None]).pixels[0], xy, 1e-4)
        np.testing.assert_allclose(
            camera.distort(xy[None]).jacobian[0], numerical, rtol=1e-6, atol=1e-6
        )


def test_the_image_centre_of_a_fisheye_is_regular():
    distorted = FISHEYE.distort(np.zeros((1, 2)))
    np.testing.assert_allclose(distorted.pixels[0], [FISHEYE.cx, FISHEYE.cy])
    np.testing.assert_allclose(distorted.jacobian[0], np.diag([FISHEYE.fx, FISHEYE.fy]))


def test_pixels_the_model_cannot_reach_are_nan():
    # This barrel folds over: no point maps further out than about 0.6 focal lengths.
    camera = CameraModel(640, 480, 300.0, 300.0, 320.0, 240.0, "radtan", (-0.9, 0.0, 0.0, 0.0))
    assert np.all(np.isnan(camera.undistort([[630.0, 470.0]])))
    assert np.all(np.isfinite(camera.undistort([[330.0, 250.0]])))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 480, 1.0, 1.0, 0.0, 0.0), "image size 0x480 is not positive"),
        ((640, 480, -1.0, 1.0, 0.0, 0.0), "focal lengths -1.0, 1.0 are not positive"),
        ((640, 480, float("nan"), 1.0, 0.0, 0.0), "not all finite"),
        ((640, 480, 1.0, 1.0, 0.0, 0.0, "fov"), "unknown distortion model 'fov'"),
        ((640, 480, 1.0, 1.0, 0.0, 0.0, "radtan", (0.1,)), "radtan takes 4 or 5 coefficients"),
    ],
)
def test_wrong_parameters_are_named(arguments, message):
    with pytest.raises(RuledgraphError, match=message):
        CameraModel(*arguments)


def test_coefficients_of_any_sequence_make_the_same_camera():
    pinhole = (640, 480, 450.0, 450.0, 320.0, 240.0, "radtan")
    coefficients = (0.1, -0.2, 0.0, 0.01)
    cameras = {CameraModel(*pinhole, kind(coefficients)) for kind in (tuple, list, np.array)}
    assert len(cameras) == 1


def test_imu_noise_must_be_positive():
    with pytest.raises(RuledgraphError, match="accelerometer = 0"):
        ImuNoise(1e-4, 0.0, 1e-5, 1e-4)
