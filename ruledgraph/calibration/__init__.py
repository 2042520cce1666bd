# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files in and out: Kalibr, EuRoC (ASL) `sensor.yaml`, ROS CameraInfo.

calibration = read_calibration("camchain-imucam.yaml", "imu.yaml", camera="cam0")
"""

from ruledgraph.calibration.camera_fields import camera_from_info
from ruledgraph.calibration.kalibr import write_kalibr
from ruledgraph.calibration.read import TYPICAL_IMU_NOISE, read_calibration
from ruledgraph.calibration.sensor_fields import CalibrationError

__all__ = [
    "TYPICAL_IMU_NOISE",
    "CalibrationError",
    "camera_from_info",
    "read_calibration",
    "write_kalibr",
]
