# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's pose in the body and its readout, as they are known by now."""

import dataclasses

import gtsam
import numpy as np

from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import ExtrinsicsConfig
from ruledgraph.core.extrinsics import Extrinsics
from ruledgraph.core.timing import Messages


class CameraMounting:
    """Keeps what windows find of the camera's pose in the body, and images of its readout.

    Args:
        calibration: whose pose it is until then.
        config: how well that is known, and whether it is estimated.
        warnings: messages for the user.
    """

    def __init__(
        self, calibration: Calibration, config: ExtrinsicsConfig, warnings: Messages
    ) -> None:
        self.calibration = calibration
        """With pose and readout as they are known by now."""
        self._given = calibration.body_T_cam
        self._covariance = np.diag(
            np.repeat([config.rotation_sigma**2, config.translation_sigma**2], 3)
        )
        self._config = config
        self._warnings = warnings

    @property
    def extrinsics(self) -> Extrinsics | None:
        """What is known; None when it is not estimated."""
        if not self._config.estimate:
            return None
        return Extrinsics(self.calibration.body_T_cam, self._covariance)

    def turn(self, body_R_cam: FloatArray) -> None:
        """Take another rotation for the calibration's, whose translation may be in other axes."""
        translation = self.calibration.body_T_cam.translation()
        pose = gtsam.Pose3(gtsam.Rot3(body_R_cam), translation)
        self.calibration = dataclasses.replace(self.calibration, body_T_cam=pose)
        self._covariance[3:, 3:] += np.eye(3) * float(translation @ translation)

    def read_rows_within(self, readout: float) -> None:
        """Take a rolling shutter's readout, s; the stamps are those of the middle row, which clock
        offsets were found for so far.
        """
        calibration = self.calibration.with_readout(readout)
        self.calibration = dataclasses.replace(calibration, stamp_at_middle_row=True)

    def update(self, extrinsics: Extrinsics | None) -> None:
        """Take in an estimate."""
        if extrinsics is None:
            return
        pose, self._covariance = extrinsics
        self.calibration = dataclasses.replace(self.calibration, body_T_cam=pose)
        message = mounting_warning(self._given, extrinsics, self._config)
        # What first lines and other defects turn it by passes.
        self._warnings.lasting("extrinsics", message, self._config.settled_states)


def turned_by(given: gtsam.Pose3, extrinsics: Extrinsics) -> tuple[float, float]:
    """By how much the camera is turned from a given pose, and the deviation of that, rad."""
    turn = given.rotation().logmap(extrinsics.body_T_cam.rotation())
    variances = np.linalg.eigvalsh(extrinsics.covariance[:3, :3])
    return float(np.linalg.norm(turn)), float(np.sqrt(variances[-1]))


def mounting_warning(
    given: gtsam.Pose3, extrinsics: Extrinsics, config: ExtrinsicsConfig
) -> str | None:
    """What to warn of: a rotation that is well known and far from the calibration's."""
    angle, sigma = turned_by(given, extrinsics)
    if sigma > config.settled_sigma or angle < config.warn_rotation:
        return None
    return (
        f"the camera is turned by {np.degrees(angle):.1f} deg (deviation {np.degrees(sigma):.1f} "
        "deg) from where the calibration has it on the IMU: correct T_cam_imu"
    )
