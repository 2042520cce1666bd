# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""When a rolling shutter is looked for that the calibration says nothing of."""

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_mounting import CameraMounting
from ruledgraph.core.timing import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.clock_offset import ClockOffsetFinder, covered
from ruledgraph.initialization.readout import ReadoutEstimate, estimated_readout
from ruledgraph.initialization.rotation_fit import LEAST_TURNING, turning

# Standard deviations.
_SIGNIFICANT = 3.0


class ReadoutSearch:
    """Looks twice, at different images of the first seconds that turn, and uses the mean of both.

    Where the first look shows none the shutter counts as global. Args:
        mounting: whose calibration is searched for, if it does not say.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.
        warnings: messages for the user.
    """

    def __init__(self, mounting: CameraMounting, bias_sigma: float, warnings: Messages) -> None:
        self.found: tuple[float, float] | None = None
        """Readout and standard deviation, s; None where none was found."""
        self._mounting = mounting
        self._bias_sigma = bias_sigma
        self._warnings = warnings
        self._first: ReadoutEstimate | None = None
        is_unknown = mounting.calibration.line_delay is None
        self._finder = self._new_finder() if is_unknown else None

    def _new_finder(self) -> ClockOffsetFinder:
        return ClockOffsetFinder(self._mounting.calibration, self._bias_sigma)

    def add_image(self, time: float, image: NDArray[np.uint8]) -> None:
        """The next image, with its stamp in s."""
        if self._finder is not None:
            self._finder.add_image(time, image)

    def search(self, imu: ImuBuffer) -> None:
        """Look at the last images, if there are enough of them since the last look."""
        finder, calibration = self._finder, self._mounting.calibration
        if finder is None or finder.count < finder.most:
            return
        samples = imu.between(-np.inf, np.inf)
        pairs = covered(finder.pairs, samples, calibration.time_offset)
        if len(pairs.times) < finder.most // 2:
            return
        self._finder = None
        if turning(pairs, samples, calibration.time_offset) < LEAST_TURNING:
            self._finder = self._new_finder()
            return
        look = estimated_readout(pairs, samples, calibration, self._bias_sigma)
        if look is None or not look.is_certain:
            return
        if self._first is None:
            self._first, self._finder = look, self._new_finder()
            return
        value, sigma = mean_of(self._first, look)
        if value < _SIGNIFICANT * sigma:
            return
        self.found = value, sigma
        self._mounting.read_rows_within(value)
        self._warnings.append(
            f"rows are read within {1e3 * value:.0f} ms (deviation {1e3 * sigma:.0f} ms, by how "
            f"images and gyroscope turn), a rolling shutter of which the calibration says nothing: "
            f"--readout {value:.3f}, or 0 for a global shutter"
        )


def mean_of(first: ReadoutEstimate, second: ReadoutEstimate) -> tuple[float, float]:
    """Of two independent readouts, with its standard deviation, s."""
    weights = first.sigma**-2, second.sigma**-2
    total = sum(weights)
    return (weights[0] * first.value + weights[1] * second.value) / total, total**-0.5
