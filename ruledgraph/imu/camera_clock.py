# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's clock: frames are timed by what is known of its offset."""

import numpy as np

from ruledgraph.core.time_offset import TimeOffset
from ruledgraph.core.timing import Messages
from ruledgraph.imu.synchronizer import Synchronizer

# The correction follows the estimate by so much a knot, s, so that frames stay in order.
_MOST_STEP = 2e-3
# An offset known this well, and followed this closely, is worth a warning when it is so far from
# the calibration, s.
_KNOWN, _FOLLOWED, _FAR = 1e-3, 5e-4, 3e-3
# A start whose offset comes out further from what its frames were timed with is tried again, s.
RETRY = 2e-3


class CameraClock:
    """Follows the estimate of the time offset.

    Args:
        sensors: whose frames it times.
        calibrated: the calibration's offset, s.
        sigma: of that, s; 0 when it is not estimated.
        warnings: where to say that the calibration is wrong.
    """

    def __init__(
        self, sensors: Synchronizer, calibrated: float, sigma: float, warnings: Messages
    ) -> None:
        self.offset = TimeOffset(calibrated, sigma)
        """t_imu - t_cam, s, as last known; without deviation when it is not estimated."""
        self._sensors = sensors
        self._calibrated = calibrated
        self._warnings = warnings

    def update(self, offset: TimeOffset | None, confirmed: bool) -> None:
        """Take in an estimate, counted from the calibration's; frames to come are timed by it once
        it is confirmed.
        """
        if offset is None:
            return
        self.offset = offset.moved(self._calibrated)
        if not confirmed:
            return
        if message := concern(self._sensors.correction, offset, self._calibrated):
            self._warnings.once("time offset", message)
        self._sensors.correction = followed(self._sensors.correction, offset)


def followed(correction: float, offset: TimeOffset) -> float:
    """The correction for the frames to come."""
    return correction + float(np.clip(offset.value - correction, -_MOST_STEP, _MOST_STEP))


def concern(correction: float, offset: TimeOffset, calibrated: float) -> str | None:
    """What to warn of: an offset that is well known and far from the calibration's, s."""
    settled = offset.sigma < _KNOWN and abs(offset.value - correction) < _FOLLOWED
    if not settled or abs(offset.value) < _FAR:
        return None
    return (
        f"frames are taken {1e3 * (calibrated + offset.value):.1f} ms after their stamps on the "
        f"IMU's clock (deviation {1e3 * offset.sigma:.1f} ms), not {1e3 * calibrated:.1f} ms as "
        "the calibration says: correct timeshift_cam_imu"
    )
