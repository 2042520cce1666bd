# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset between camera and IMU, from how images turn and what the gyroscope says.

An image stamped t was taken at t + tau on the IMU's clock, a rolling shutter's middle row half the
readout later; its rays are turned by the gyroscope to that time first. Between the images of a pair
the camera turned, in its own axes, by

    w(tau, b, phi) = Exp(-phi) cam_R_body (integral of the gyroscope over [t1 + tau, t2 + tau]
                                           - b (t2 - t1)),

with b the gyroscope's bias and phi what the calibrated mounting is off by. What the points of the
images say of w (see `image_rotation`) makes this a fit of least squares. As the match can be
ambiguous, tau is searched over a range, with the best b and phi for each. Variances are those of
the residuals: what the best common parameters leave, of what the turns of the single pairs would.

No offset is given where the motion does not show it: it must be much more likely than all others
of the range further than six of its standard deviations, and than that nothing turns.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.image_rotation import PointPairs, tracked_rays
from ruledgraph.initialization.rotation_fit import (
    MIN_RATE_VARIATION,
    PARAMETERS,
    RotationFit,
    rate_variation,
)
from ruledgraph_factors import ImuSamples

RANGE = 0.1
"""Offsets this far from the calibration's are searched, s."""
# Of the search, s; between the last ones the minimum is interpolated.
_STEP, _FINE = 0.01, 0.002
# Images of a pair are this far apart at the least, s: less turning does not show; and not so far.
_APART, _TOO_FAR = 0.045, 0.3
# Degrees of freedom, of three a pair, without which variances mean nothing.
_MIN_FREE = 20
# Share of the pairs that must be new since the last fit: fewer hardly change it.
_NEW_SHARE = 0.2
# Others that are this many standard deviations away must be less likely by a chi^2 of this much,
# which the best of twenty that are all equally wrong seldom reaches.
_BEYOND, _BEATEN = 6.0, 30.0
# What one offset for all rows and images leaves out, s: stamps scatter, and the rows of a rolling
# shutter that the calibration says nothing of are read over 10 to 30 ms, which has a standard
# deviation of 3 to 9 ms.
_UNMODELLED = 5e-3


class FoundTimeOffset(NamedTuple):
    """What was found."""

    value: float
    """t_imu - t_cam, s."""
    sigma: float
    """Its standard deviation, s."""
    gyroscope_bias: FloatArray
    """(3,), rad/s."""
    mounting: FloatArray
    """phi: the mounting is body_R_cam Exp(phi), (3,), rad."""


class TimeOffsetFinder:
    """Is handed images as they come, and finds the offset from those of the last seconds.

    Args:
        calibration: the offset is searched about its offset, `RANGE` to both sides.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.
        max_pairs: of images kept.
    """

    def __init__(self, calibration: Calibration, bias_sigma: float, max_pairs: int = 40) -> None:
        self.max_pairs = max_pairs
        self._calibration = calibration
        self._bias_sigma = bias_sigma
        self._before: tuple[float, NDArray[np.uint8]] | None = None
        self._times: deque[tuple[float, float]] = deque(maxlen=max_pairs)
        self._rays: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=max_pairs)
        self._new = 0  # pairs since the last fit

    def add_image(self, time: float, image: NDArray[np.uint8]) -> None:
        """The next image, with its stamp in s."""
        time += self._calibration.middle_row_delay
        if self._before is not None:
            before, last = self._before
            if time - before < _APART:
                return
            near = time - before < _TOO_FAR
            rays = tracked_rays(last, image, self._calibration.camera) if near else None
            if rays is not None:
                self._times.append((before, time))
                self._rays.append(rays)
                self._new += 1
        self._before = time, image

    @property
    def count(self) -> int:
        """Of the pairs that are kept."""
        return len(self._rays)

    @property
    def pairs(self) -> PointPairs:
        """Those that are kept."""
        rays = np.array(self._rays) if self._rays else np.zeros((0, 2, 1, 3))
        times = np.array(self._times).reshape(-1, 2)
        return PointPairs(times, rays[:, 0], rays[:, 1])

    def find(self, samples: ImuSamples) -> FoundTimeOffset | None:
        """The offset by the pairs whose gyroscope's samples are there over the whole range.

        None where there are too few, or too few new ones, or the motion does not show it.
        """
        if self._new < _NEW_SHARE * self.count:
            return None
        pairs = covered(self.pairs, samples, self._calibration.time_offset)
        if 3 * len(pairs.times) - PARAMETERS < _MIN_FREE:
            return None
        self._new = 0
        return fit_offset(pairs, samples, self._calibration, self._bias_sigma)


def covered(pairs: PointPairs, samples: ImuSamples, offset: float) -> PointPairs:
    """The pairs with samples over the range of offsets about one."""
    first, last = samples.times[0] + RANGE, samples.times[-1] - RANGE
    kept = (pairs.times[:, 0] + offset >= first) & (pairs.times[:, 1] + offset <= last)
    return PointPairs(pairs.times[kept], pairs.before[kept], pairs.after[kept])


def fit_offset(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, bias_sigma: float
) -> FoundTimeOffset | None:
    """The offset by all of these pairs; see `TimeOffsetFinder`."""
    if rate_variation(pairs, samples, calibration.time_offset) < MIN_RATE_VARIATION:
        return None
    fit = RotationFit(pairs, samples, calibration, bias_sigma)
    steps = round(RANGE / _STEP)
    coarse = np.array([calibration.time_offset + _STEP * i for i in range(-steps, steps + 1)])
    costs = fit.profile(coarse)
    best = int(np.argmin(costs.sum(axis=1)))
    around = np.linspace(-_STEP, _STEP, 2 * round(_STEP / _FINE) + 1)
    fine = np.array([coarse[best] + t for t in around.tolist()])
    sums = fit.profile(fine).sum(axis=1)
    lowest = int(np.argmin(sums))
    if not 0 < lowest < len(fine) - 1:
        return None
    left, here, right = sums[lowest - 1 : lowest + 2]
    offset = float(fine[lowest]) + 0.5 * _FINE * (left - right) / (left - 2.0 * here + right)
    found = fit.linearized(fit.best_at(offset))
    sigma = float(found.sigmas[0])
    far = np.abs(coarse - offset) > _BEYOND * sigma
    others = np.append(costs.sum(axis=1)[far], fit.no_rotation_cost)
    if others.min() - found.evidence.costs.sum() < _BEATEN * found.variance:
        return None
    x = found.solution()
    sigma = float(np.hypot(sigma, _UNMODELLED))
    return FoundTimeOffset(offset, sigma, x[1:4], x[4:])
