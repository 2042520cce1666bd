# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations as Kalibr, EuRoC and ROS write them, and what they say."""

from dataclasses import replace

import gtsam
import numpy as np

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.calibration.rig import Calibration

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


def assert_pose(pose: gtsam.Pose3, matrix: np.ndarray, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(pose.matrix(), matrix, rtol=0, atol=atol)


def assert_same(read: Calibration, wanted: Calibration) -> None:
    assert_pose(read.body_T_cam, wanted.body_T_cam.matrix())
    assert replace(read, body_T_cam=wanted.body_T_cam) == wanted
