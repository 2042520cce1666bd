# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a calibrated mounting is grossly wrong: axes exchanged, T_imu_cam for T_cam_imu."""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.rotation_fit import MIN_RATE_VARIATION, RotationFit, rate_variation
from ruledgraph.initialization.time_offset_finder import FoundTimeOffset, fit_offset
from ruledgraph_factors import ImuSamples

MIN_PAIRS = 20
"""Pairs of images without which nothing can be said."""
BETTER = 0.7
"""The error of another mounting must be this much smaller for a warning: by chance the medians of
400 points, the fewest there are, differ by 8 % (standard deviation)."""
# px; good calibrations leave 0.10 to 0.15, those of another lens or of other axes 0.4 or more.
_USUAL_ERROR = 0.3
# A mirror turns rotations about its normal the same way, and those about other axes the other way:
# as if the camera were turned by half a turn about that normal.
_MIRRORS = {"left to right": (1.0, -1.0, -1.0), "upside down": (-1.0, 1.0, -1.0)}


class MountingCheck(NamedTuple):
    """What a calibrated mounting was found to be."""

    error: float
    """How far points miss the gyroscope's turns with it, px."""
    other: float
    """The same of the best of the other mountings, px ..."""
    other_body_R_cam: FloatArray
    """... and that one, (3, 3)."""
    mirrored: float
    """The same of the best mounting of an IMU that turns the other way, whose axes are left-handed,
    px; infinite where the error is usual."""
    image_mirror: str
    """How images are mirrored that turn like the calibrated mounting with the best other one:
    `left to right`, `upside down`, or empty."""
    time_offset: FoundTimeOffset | None
    """That all of this is with; None where the pairs do not show it: the calibration's."""

    @property
    def is_usual(self) -> bool:
        """Whether the error is one of a good calibration."""
        return self.error <= _USUAL_ERROR

    @property
    def wrong(self) -> bool:
        """Whether another one explains the points far better."""
        return self.other < BETTER * self.error or self.is_mirrored

    @property
    def is_mirrored(self) -> bool:
        """Whether an IMU that turns the other way explains the points far better than any other."""
        return self.mirrored < BETTER * min(self.error, self.other)

    def message(self, *, from_images: bool) -> str:
        """What to say of a mounting that is wrong; `from_images` as in `ExtrinsicsConfig`."""
        if self.is_mirrored:
            return (
                f"image points disagree with the gyroscope by {self.error:.2g} px, and by "
                f"{self.mirrored:.2g} px if it turned the other way: are its axes right-handed, as "
                "x forward, y left, z up, and its rates counter-clockwise?"
            )
        use = "--set extrinsics.from_images=true uses it"
        if from_images:
            use = "extrinsics.from_images uses it"
        disagrees = (
            f"image points disagree with the gyroscope by {self.error:.2g} px, by "
            f"{self.other:.2g} px with the rotation {self._rows} ({use}; the translation of "
            "T_cam_imu has to be corrected, too)"
        )
        if self.image_mirror:
            return (
                f"the images may be mirrored ({self.image_mirror}), for which no T_cam_imu is "
                f"right: record them as the lens shows them; or T_cam_imu is wrong: {disagrees}"
            )
        return f"T_cam_imu looks wrong: {disagrees}"

    @property
    def _rows(self) -> str:
        """Of T_cam_imu, to paste."""
        return str(self.other_body_R_cam.T.round(4).tolist())


def check_mounting(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, bias_sigma: float
) -> MountingCheck | None:
    """Compare the mounting with its inverse and those with the camera's axes exchanged.

    Args:
        pairs: of images, covered by `samples`.
        samples: of the gyroscope.
        calibration: whose mounting is checked.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.

    Returns:
        None where there are too few pairs, or they turn too little.
    """
    offset = calibration.time_offset
    if len(pairs.times) < MIN_PAIRS or rate_variation(pairs, samples, offset) < MIN_RATE_VARIATION:
        return None
    found = fit_offset(pairs, samples, calibration, bias_sigma)
    if found is not None:
        offset = found.value

    def error(mounting: FloatArray, samples: ImuSamples = samples) -> float:
        body_T_cam = gtsam.Pose3(gtsam.Rot3(mounting), calibration.body_T_cam.translation())
        other = dataclasses.replace(calibration, body_T_cam=body_T_cam)
        fit = RotationFit(pairs, samples, other, bias_sigma)
        return fit.error(fit.best_at(offset))

    calibrated = calibration.body_T_cam.rotation().matrix()
    others = list(_others(calibrated))
    errors = [error(mounting) for mounting in others]
    best = int(np.argmin(errors))
    check = MountingCheck(
        error(calibrated),
        errors[best],
        others[best],
        np.inf,
        _image_mirror(calibrated, others[best]),
        found,
    )
    if check.is_usual:
        return check
    # Rates in left-handed axes are those of a rotation the other way, in some right-handed ones.
    reversed_ = ImuSamples(samples.times, -samples.gyroscope, samples.accelerometer)
    mirrored = min(error(mounting, reversed_) for mounting in (calibrated, *others))
    return check._replace(mirrored=mirrored)


def _image_mirror(calibrated: FloatArray, other: FloatArray) -> str:
    """How images are mirrored that turn as if they were taken with another mounting, if any."""
    for name, signs in _MIRRORS.items():
        if np.allclose(calibrated * signs, other):
            return name
    return ""


def _others(calibrated: FloatArray) -> Iterator[FloatArray]:
    """The other 23 mountings with the camera's axes exchanged, and the inverse."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * signs
            if np.linalg.det(R) > 0.0 and not np.allclose(R, np.eye(3)):
                yield calibrated @ R
    yield calibrated.T
