# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Time offset, mounting and readout by the rotation of the images: when they are looked for in a
stream, and what is done with them.

From the first images of a segment on until it is found: before the start, and where that was at
rest in the first second that turns. It is used where it differs significantly from what was known.
"""

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.core.messages import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.mounting_check import check_mounting
from ruledgraph.initialization.readout_search import ReadoutSearch
from ruledgraph.initialization.time_offset_finder import FoundTimeOffset, TimeOffsetFinder, covered
from ruledgraph.synchronization.camera_clock import CameraClock
from ruledgraph_factors import ImuSamples

# Standard deviations.
_SIGNIFICANT = 3.0


class CalibrationSearch:
    """Looks for time offset, mounting and readout until the images of a segment have shown them."""

    def __init__(
        self,
        online_calibration: OnlineCalibration,
        clock: CameraClock,
        config: Config,
        warnings: Messages,
    ) -> None:
        self.found: FoundTimeOffset | None = None
        """The last one, whether used or not."""
        self.used = False
        """Whether frames were timed with one that was found."""
        self.readout = ReadoutSearch(online_calibration, config.start.gyroscope_bias, warnings)
        """Of the camera's rows, looked for in the same images."""
        self.rotation_replaced = False
        """Whether the last search has replaced the calibration's rotation of the camera."""
        self._online_calibration = online_calibration
        self._clock = clock
        self._config = config
        self._warnings = warnings
        self._finder: TimeOffsetFinder | None = None
        self._checked = False
        self._latest = -np.inf
        self._begun = np.inf
        self.restart()
        if self._finder is not None and self.readout.finder is not None:
            self._finder = self.readout.finder  # one for both, which tracks points once

    def restart(self) -> None:
        """A segment has ended."""
        self._begun = np.inf
        if self._config.time_offset.estimate or not self._checked:
            bias_sigma = self._config.start.gyroscope_bias
            self._finder = TimeOffsetFinder(self._online_calibration.current, bias_sigma)

    def add_image(self, time: float, image: NDArray[np.uint8]) -> None:
        """The next image, with its stamp in s; one that was there before tells nothing new."""
        if time <= self._latest:
            return
        self._latest, self._begun = time, min(time, self._begun)
        for finder in {self._finder, self.readout.finder}:
            if finder is not None:
                finder.add_image(time, image)

    def search(self, imu: ImuBuffer, known: TimeOffset, by_window: bool) -> TimeOffset | None:
        """The offset, if it is found by now and differs significantly from the known one.

        Args:
            imu: the samples of the last seconds.
            known: t_imu - t_cam, s, as far as it is known.
            by_window: whether a window whose lines and IMU agree has estimated the known one. Where
                that is more precise it stands: the window's model includes the translation, while
                images of a plane turn in two ways equally well (that of the camera, and one that
                explains the translation).
        """
        self.rotation_replaced = False
        found = self._search(imu, known, by_window)
        self.readout.search(imu, self.found and self.found.value)
        return found

    def contradicts_known(self, offset: float) -> bool:
        """Whether an offset that a start has found, s, contradicts what is known, while images may
        show it: those of as long as the longest first window.
        """
        if self._finder is None or self._latest - self._begun >= self._config.start.longest:
            return False
        prior = self._clock.start_prior
        known = self._clock.offset.value
        return prior is not None and abs(offset - known) > _SIGNIFICANT * prior.sigma

    def _search(self, imu: ImuBuffer, known: TimeOffset, by_window: bool) -> TimeOffset | None:
        if self._finder is None:
            return None
        samples = imu.between(-np.inf, np.inf)
        is_exact = not self._config.time_offset.estimate
        found = None if is_exact else self._finder.find(samples)
        if found is None:
            self._check_mounting(self._finder, samples)
            if is_exact and self._checked:
                self._finder = None
            return None
        self._finder, self.found = None, found
        if by_window and known.sigma < found.sigma:
            return None
        change = found.value - known.value
        differs = abs(change) >= _SIGNIFICANT * np.hypot(found.sigma, known.sigma)
        # What stands is known as well as that.
        sigma = found.sigma if differs else float(np.hypot(found.sigma, change))
        self._clock.narrow_start_prior(sigma)
        if not differs:
            return None
        self.used = True
        self._warnings.append(
            f"t_imu - t_cam = {1e3 * found.value:.1f} ± {1e3 * found.sigma:.1f} ms from image "
            f"rotation and gyroscope, not {1e3 * known.value:.1f} ms: correct timeshift_cam_imu"
        )
        return TimeOffset(found.value, found.sigma)

    def _check_mounting(self, finder: TimeOffsetFinder, samples: ImuSamples) -> None:
        """Once, when the images do not turn as the gyroscope says."""
        if self._checked or finder.count < finder.max_pairs:
            return
        calibration = self._online_calibration.current
        pairs = covered(finder.pairs, samples, calibration.time_offset)
        bias_sigma = self._config.start.gyroscope_bias
        check = check_mounting(pairs, samples, calibration, bias_sigma)
        self._checked = check is not None
        if check is not None and check.wrong:
            is_replaced = self._config.extrinsics.from_images
            self._warnings.append(check.message(from_images=is_replaced))
            if is_replaced and not check.is_mirrored:
                self._online_calibration.set_rotation(check.other_body_R_cam)
                self.rotation_replaced = True
                self.restart()
