# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's pose in the body, its readout and its focal length, as they are known by now."""

import dataclasses

import gtsam
import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import Extrinsics, FocalRatio
from ruledgraph.core.config import Config, ExtrinsicsConfig, IntrinsicsConfig
from ruledgraph.core.messages import Messages

# Standard deviations. Points are undistorted by few focal lengths, one after another, as those of a
# window should fit together.
_SIGNIFICANT = 3.0


class OnlineCalibration:
    """Keeps what windows find of the camera's pose in the body and its focal length, and images of
    its readout.

    Args:
        calibration: whose they are until then.
        config: how well they are known, and whether they are estimated.
        warnings: messages for the user.
    """

    def __init__(self, calibration: Calibration, config: Config, warnings: Messages) -> None:
        self.current = calibration
        """With pose and readout as they are known by now."""
        self.camera = calibration.camera
        """That points are undistorted by: the calibration's, or, once the focal length is known to
        be another one, bent by that (`CameraModel.bent_by`)."""
        self._bent_by = 1.0
        self._given = calibration.body_T_cam
        self._extrinsics, self._intrinsics = config.extrinsics, config.intrinsics
        sigmas = self._extrinsics.rotation_sigma, self._extrinsics.translation_sigma
        self._covariance = np.diag(np.repeat(np.square(sigmas), 3))
        self._focal_ratio = FocalRatio(1.0, self._intrinsics.focal_sigma)
        self._warnings = warnings

    @property
    def extrinsics(self) -> Extrinsics | None:
        """What is known; None when it is not estimated."""
        if not self._extrinsics.estimate:
            return None
        return Extrinsics(self.current.body_T_cam, self._covariance)

    @property
    def focal_ratio(self) -> FocalRatio | None:
        """Of the focal length to the calibration's; None when it is not estimated. In the image of
        a wide-angle lens another focal length is more than another scale.
        """
        estimated = self._intrinsics.estimate and self.camera.distortion in ("none", "radtan")
        return self._focal_ratio if estimated else None

    @property
    def ratio(self) -> float:
        """The same without its deviation, 1 when it is not estimated."""
        return self._focal_ratio.value

    def set_rotation(self, body_R_cam: FloatArray) -> None:
        """Take another rotation for the calibration's, whose translation may be in other axes."""
        translation = self.current.body_T_cam.translation()
        pose = gtsam.Pose3(gtsam.Rot3(body_R_cam), translation)
        self.current = dataclasses.replace(self.current, body_T_cam=pose)
        self._covariance[3:, 3:] += np.eye(3) * float(translation @ translation)

    def set_readout(self, readout: float) -> None:
        """Take a rolling shutter's readout, s; the stamps are those of the middle row, which clock
        offsets were found for so far.
        """
        calibration = self.current.with_readout(readout)
        self.current = dataclasses.replace(calibration, stamp_at_middle_row=True)

    def update(self, extrinsics: Extrinsics | None, focal_ratio: FocalRatio | None) -> None:
        """Take in estimates."""
        # What first lines and other defects change passes.
        if extrinsics is not None:
            pose, self._covariance = extrinsics
            self.current = dataclasses.replace(self.current, body_T_cam=pose)
            message = mounting_warning(self._given, extrinsics, self._extrinsics)
            self._warnings.lasting("extrinsics", message, self._extrinsics.settled_states)
        if focal_ratio is not None:
            self._focal_ratio = focal_ratio
            message = focal_warning(focal_ratio, self._intrinsics)
            states = self._intrinsics.settled_states
            settled = self._warnings.lasting("focal length", message, states)
            differs = abs(self.ratio - self._bent_by) > _SIGNIFICANT * focal_ratio.sigma
            if settled and differs:
                self._bent_by = self.ratio
                self.camera = self.current.camera.bent_by(self.ratio)


def turned_by(given: gtsam.Pose3, extrinsics: Extrinsics) -> tuple[float, float]:
    """By how much the camera is turned from a given pose, and the deviation of that, rad."""
    turn = given.rotation().logmap(extrinsics.body_T_cam.rotation())
    variances = np.linalg.eigvalsh(extrinsics.covariance[:3, :3])
    return float(np.linalg.norm(turn)), float(np.sqrt(variances[-1]))


def mounting_warning(
    given: gtsam.Pose3, extrinsics: Extrinsics, config: ExtrinsicsConfig
) -> str | None:
    """What to warn of: a rotation that is far from the calibration's."""
    angle, sigma = turned_by(given, extrinsics)
    if angle < max(config.warn_rotation, _SIGNIFICANT * sigma):
        return None
    return (
        f"the camera is turned by {np.degrees(angle):.1f} ± {np.degrees(sigma):.1f} deg from "
        "where the calibration has it on the IMU: correct T_cam_imu"
    )


def focal_warning(found: FocalRatio, config: IntrinsicsConfig) -> str | None:
    """What to warn of: a focal length that is far from the calibration's."""
    change = found.value - 1.0
    if abs(change) < max(config.warn_change, _SIGNIFICANT * found.sigma):
        return None
    return (
        f"the focal length is {100.0 * abs(change):.1f} ± {100.0 * found.sigma:.1f} % "
        f"{'longer' if change > 0.0 else 'shorter'} than the calibration's: correct intrinsics"
    )
