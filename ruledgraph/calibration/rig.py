# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""One camera and one IMU: what is known of them before the first measurement."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.errors import RuledgraphError


@dataclass(frozen=True)
class Calibration:
    """One camera and the IMU, the body frame being the IMU's."""

    camera: CameraModel
    body_T_cam: gtsam.Pose3
    """Maps camera coordinates (optical axes) to the body frame."""
    imu_noise: ImuNoise
    time_offset: float = 0.0
    """s; t_imu = t_cam + time_offset (Kalibr's `timeshift_cam_imu`)."""
    image_topic: str | None = None
    """The topic the calibration was made for, when the file names one."""
    imu_topic: str | None = None
    time_offset_exact: bool = False
    """Whether `time_offset` is exact, as of cameras that the IMU's clock triggers, and not to be
    estimated (`timeshift_exact: true` beside `timeshift_cam_imu`)."""
    line_delay: float | None = None
    """s; row r of an image is exposed r line_delay later than row 0 (Kalibr's `line_delay`). 0: a
    global shutter; None: not known, a global shutter unless the images show another."""
    stamp_at_middle_row: bool = False
    """Whether the stamp of an image is that of its middle row, not of the first one."""

    def __post_init__(self) -> None:
        if not 0.0 <= (self.line_delay or 0.0) < np.inf:
            raise RuledgraphError(f"line_delay = {self.line_delay} s is negative or not finite")

    @property
    def readout(self) -> float:
        """From the first row's exposure to the last one's, s."""
        return (self.line_delay or 0.0) * (self.camera.height - 1)

    @property
    def middle_row_delay(self) -> float:
        """From the stamp of an image to the exposure of its middle row, s."""
        return 0.0 if self.stamp_at_middle_row else 0.5 * self.readout

    def with_readout(self, readout: float) -> "Calibration":
        """The same with another time from the first row to the last, s."""
        return replace(self, line_delay=readout / max(self.camera.height - 1, 1))


@dataclass(frozen=True)
class Mounting:
    """What a recording without the IMU's noise figures tells of its sensors; as `Calibration`."""

    camera: CameraModel
    body_T_cam: gtsam.Pose3
    imu_noise: None = None
