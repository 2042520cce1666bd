# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""When a rolling shutter is looked for that the calibration says nothing of."""

from typing import NamedTuple

import numpy as np

from ruledgraph.calibration.camera_mounting import CameraMounting
from ruledgraph.core.timing import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.clock_offset import ClockOffsetFinder, covered
from ruledgraph.initialization.readout import ReadoutEstimate, estimated_readout
from ruledgraph.initialization.rotation_fit import LEAST_TURNING, turning

# Standard deviations.
_SIGNIFICANT = 3.0


class Readout(NamedTuple):
    """Of a rolling shutter."""

    value: float
    """s."""
    sigma: float
    """Its standard deviation, s."""


class ReadoutSearch:
    """Looks at images of the first seconds that turn, and at others after them.

    What the first look finds is used if it is significant, the mean of both after the second, or
    nothing if either shows none.

    Args:
        mounting: whose calibration is searched for, if it does not say.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.
        warnings: messages for the user.
    """

    def __init__(self, mounting: CameraMounting, bias_sigma: float, warnings: Messages) -> None:
        self.found: Readout | None = None
        """None where none was found."""
        self._mounting = mounting
        self._bias_sigma = bias_sigma
        self._warnings = warnings
        self._first: ReadoutEstimate | None = None
        is_unknown = mounting.calibration.line_delay is None
        self.finder = self._new_finder() if is_unknown else None
        """To be handed each image; None when no more are needed."""

    def _new_finder(self) -> ClockOffsetFinder:
        return ClockOffsetFinder(self._mounting.calibration, self._bias_sigma)

    def search(self, imu: ImuBuffer) -> None:
        """Look at the last images, if there are enough of them since the last look."""
        finder = self.finder
        if finder is None or finder.count < finder.most:
            return
        samples, as_global = imu.between(-np.inf, np.inf), self._mounting.calibration
        as_global = as_global.with_readout(0.0)
        pairs = covered(finder.pairs, samples, as_global.time_offset)
        if len(pairs.times) < finder.most // 2:
            return
        if turning(pairs, samples, as_global.time_offset) < LEAST_TURNING:
            self.finder = self._new_finder()
            return
        look = estimated_readout(pairs, samples, as_global, self._bias_sigma)
        first, self.finder = self._first, None
        if look is None or not look.is_certain:
            self._take(None)
        elif first is None:
            self._first, self.finder = look, self._new_finder()
            self._take(Readout(look.value, look.sigma))
        else:
            self._take(mean_of(first, look))

    def _take(self, readout: Readout | None) -> None:
        """Use what was found, if it differs significantly from none."""
        if readout is not None and readout.value > _SIGNIFICANT * readout.sigma:
            self.found = readout
            self._mounting.read_rows_within(readout.value)
            self._warnings.once(
                "rolling shutter",
                f"rows are read within {1e3 * readout.value:.0f} ms (deviation "
                f"{1e3 * readout.sigma:.0f} ms, by how images and gyroscope turn), a rolling "
                f"shutter of which the calibration says nothing: --readout {readout.value:.3f}, "
                "or 0 for a global shutter",
            )
        elif self.found is not None:
            self.found = None
            self._mounting.read_rows_within(0.0)
            self._warnings.append(
                "later images do not show that rows are read one after the other: the shutter "
                "counts as global"
            )


def mean_of(first: ReadoutEstimate, second: ReadoutEstimate) -> Readout:
    """Of two independent ones, by their variances."""
    weights = first.sigma**-2, second.sigma**-2
    total = sum(weights)
    value = (weights[0] * first.value + weights[1] * second.value) / total
    return Readout(value, total**-0.5)
