# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""When a rolling shutter is looked for that the calibration says nothing of."""

from typing import NamedTuple

import numpy as np

from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.core.messages import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.readout import ReadoutEstimate, estimated_readout
from ruledgraph.initialization.rotation_fit import MIN_RATE_VARIATION, rate_variation
from ruledgraph.initialization.time_offset_finder import TimeOffsetFinder, covered

# Standard deviations.
_SIGNIFICANT = 3.0
# s; better it need not be known: hands turn a camera by 0.5 rad/s, in this time by half a pixel.
_ENOUGH = 2e-3
# Pairs of images of the first look: of nine or ten that agree a sign test says enough.
_MIN_PAIRS = 10


class Readout(NamedTuple):
    """Of a rolling shutter."""

    value: float
    """s."""
    sigma: float
    """Its standard deviation, s."""


class ReadoutSearch:
    """Looks at images of the first seconds that turn, and at others after them.

    The first ones are looked at as soon as there are a few, and again when there are twice as many;
    if these show none, the shutter is global. Else it goes on with others and takes the mean of
    all. What is found is used as long as it is significant.

    Args:
        online_calibration: whose readout is searched for, if it does not say.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.
        warnings: messages for the user.
    """

    def __init__(
        self, online_calibration: OnlineCalibration, bias_sigma: float, warnings: Messages
    ) -> None:
        self.found: Readout | None = None
        """None where none was found."""
        self.finder: TimeOffsetFinder | None = None
        """To be handed each image; None when no more are needed."""
        self._online_calibration = online_calibration
        self._bias_sigma = bias_sigma
        self._warnings = warnings
        self._mean: Readout | None = None
        self._next_look = _MIN_PAIRS
        if online_calibration.current.line_delay is None:
            self._begin()

    def _begin(self) -> None:
        """With new images."""
        finder = TimeOffsetFinder(self._online_calibration.current, self._bias_sigma)
        self.finder = finder
        self._next_look = _MIN_PAIRS if self._mean is None else finder.max_pairs

    def search(self, imu: ImuBuffer, offset: float | None = None) -> None:
        """Look at the last images, if there are enough of them since the last look.

        Args:
            imu: the samples of the last seconds.
            offset: t_imu - t_cam, s, if it is known.
        """
        finder = self.finder
        if finder is None or finder.count < self._next_look:
            return
        samples, as_global = imu.between(-np.inf, np.inf), self._online_calibration.current
        as_global = as_global.with_readout(0.0)
        pairs = covered(finder.pairs, samples, as_global.time_offset)
        if 2 * len(pairs.times) < self._next_look:
            return
        are_all = finder.count == finder.max_pairs
        if are_all and rate_variation(pairs, samples, as_global.time_offset) < MIN_RATE_VARIATION:
            self._begin()
            return
        look = estimated_readout(pairs, samples, as_global, self._bias_sigma, offset)
        if are_all:
            self._average(look)
            return
        self._next_look *= 2
        if look is not None and look.is_certain and _is_significant(look):
            self._use(Readout(look.value, look.sigma))

    def _average(self, look: ReadoutEstimate | None) -> None:
        """Take in what all of the last images show, and go on as long as there is use in it."""
        is_first = self._mean is None
        if look is not None and (look.is_certain or not is_first):
            found = Readout(look.value, look.sigma)
            self._mean = found if self._mean is None else mean_of(self._mean, found)
        mean = self._mean
        if mean is not None:
            goes_on = mean.sigma > _ENOUGH and (is_first or _is_significant(mean))
        else:  # a few pairs that fit badly say nothing
            goes_on = look is not None and look.is_better
        if mean is not None or not goes_on:
            self._use(mean)
        self.finder = None
        if goes_on:
            self._begin()

    def _use(self, readout: Readout | None) -> None:
        """What was found, if it differs significantly from a global shutter's."""
        if readout is not None and _is_significant(readout):
            self.found = readout
            self._online_calibration.set_readout(readout.value)
            self._warnings.once(
                "rolling shutter",
                f"rolling shutter: readout {1e3 * readout.value:.0f} ± {1e3 * readout.sigma:.0f} "
                "ms from image rotation and gyroscope, not in the calibration: pass "
                f"--readout {readout.value:.3f}, or 0 for a global shutter",
            )
        elif self.found is not None:
            self.found = None
            self._online_calibration.set_readout(0.0)
            self._warnings.append(
                "later images do not show that rows are read one after the other: the shutter "
                "counts as global"
            )


def _is_significant(readout: Readout | ReadoutEstimate) -> bool:
    return readout.value > _SIGNIFICANT * readout.sigma


def mean_of(first: Readout, second: Readout) -> Readout:
    """Of two independent ones, by their variances."""
    weights = first.sigma**-2, second.sigma**-2
    total = sum(weights)
    value = (weights[0] * first.value + weights[1] * second.value) / total
    return Readout(value, total**-0.5)
