# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's clock: frame times from stamps and the estimated offset."""

import numpy as np

from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import TimeOffsetConfig
from ruledgraph.core.messages import Messages
from ruledgraph.synchronization.synchronizer import Synchronizer

# Standard deviations.
_SIGNIFICANT = 3.0


class CameraClock:
    """Times the frames to come by the estimated time offset.

    Args:
        synchronizer: whose frames it times.
        calibrated: the calibration's offset, s.
        config: whether it is estimated, and how fast frame times are corrected.
        warnings: messages for the user.
    """

    def __init__(
        self,
        synchronizer: Synchronizer,
        calibrated: float,
        config: TimeOffsetConfig,
        warnings: Messages,
    ) -> None:
        sigma = config.sigma if config.estimate else 0.0
        self.offset = TimeOffset(calibrated, sigma)
        """t_imu - t_cam, s, as last known; sigma 0 when it is not estimated."""
        self._start_sigma = config.sigma
        self._config = config
        self._synchronizer = synchronizer
        self._calibrated = calibrated
        self._warnings = warnings

    @property
    def start_prior(self) -> TimeOffset | None:
        """How much later than their times the frames of a start may have been taken; None where the
        offset is not estimated.
        """
        return TimeOffset(0.0, self._start_sigma) if self._config.estimate else None

    def narrow_start_prior(self, sigma: float) -> None:
        """To this standard deviation, s, if it is less than the prior's."""
        self._start_sigma = min(sigma, self._start_sigma)

    def update(self, offset: TimeOffset | None, confirmed: bool) -> None:
        """Take in an estimate, counted from the calibration's, if its start is confirmed; frames to
        come are timed by it.
        """
        if offset is None or not confirmed:
            return
        self.offset = offset.plus(self._calibrated)
        offset_correction, config = self._synchronizer.offset_correction, self._config
        message = offset_warning(offset_correction, offset, self._calibrated, config)
        self._warnings.lasting("time offset", message, config.settled_states)
        self._synchronizer.offset_correction = corrected_offset(offset_correction, offset, config)


def corrected_offset(
    offset_correction: float, offset: TimeOffset, config: TimeOffsetConfig
) -> float:
    """What to add to the calibration's offset for the frames to come, s."""
    step = config.max_step
    return offset_correction + float(np.clip(offset.value - offset_correction, -step, step))


def offset_warning(
    offset_correction: float, offset: TimeOffset, calibrated: float, config: TimeOffsetConfig
) -> str | None:
    """What to warn of: an offset that is far from the calibration's, s, and that the frames' times
    have followed.
    """
    noise = _SIGNIFICANT * offset.sigma
    is_followed = abs(offset.value - offset_correction) < noise
    if not is_followed or abs(offset.value) < max(config.warn_offset, noise):
        return None
    return (
        f"t_imu - t_cam = {1e3 * (calibrated + offset.value):.1f} ± {1e3 * offset.sigma:.1f} ms, "
        f"not {1e3 * calibrated:.1f} ms as the calibration says: correct timeshift_cam_imu"
    )
