# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The IMU's samples, and their cutting into segments of constant measurement."""

from collections.abc import Iterator
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.integration import segments_in_numpy
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.validation import (
    SAME_TIME,
    FloatArray,
    finite_array,
    increasing_times,
    instance,
    number,
)


class ImuSegment(NamedTuple):
    """A stretch of constant IMU measurement, in the argument order of GTSAM's
    `integrateMeasurement(accelerometer, gyroscope, dt)`.
    """

    accelerometer: FloatArray
    gyroscope: FloatArray
    dt: float


class ImuSamples:
    """Raw IMU samples: strictly increasing times (N,) in s, gyroscope (N, 3) in rad/s and
    accelerometer (N, 3) in m/s^2 (specific force), both in the body frame, N >= 2.

    Any rate, also an uneven one. Between samples both signals are interpolated linearly, over a gap
    in the recording, too: look for gaps before.

    Raises:
        FactorError: for NaN, wrong shapes, times that do not increase, fewer than two samples.
    """

    def __init__(self, times: ArrayLike, gyroscope: ArrayLike, accelerometer: ArrayLike) -> None:
        self.times = increasing_times("times", times)
        count = self.times.size
        if count < 2:
            raise FactorError("times: at least two IMU samples are needed, got 1")
        self.gyroscope = finite_array("gyroscope", gyroscope, (count, 3))
        self.accelerometer = finite_array("accelerometer", accelerometer, (count, 3))

    def segments(
        self,
        start: float,
        stop: float,
        at: ArrayLike = (),
        bias: gtsam.imuBias.ConstantBias | None = None,
    ) -> Iterator[ImuSegment]:
        """Constant-measurement segments that cover [start, stop] without a gap (s).

        Segments break at every sample and at every time in `at`. Each carries the mean of the
        interpolated signal over its length. Its accelerometer value is turned from the middle of
        the segment to its start, f' = Exp((w - b_g) dt / 2) (f - b_a) + b_a: GTSAM's integrators
        apply it with the orientation at the start, an error of w x f dt / 2 (0.02 m/s^2 at 1 rad/s
        and 200 Hz) that this takes out.

        Feed the segments to a GTSAM preintegration, so that the factor between two states and the
        frames between them see the same motion.

        Args:
            start: within the samples, s.
            stop: likewise, not before `start`.
            at: further times to break at, such as frame times.
            bias: current estimate, by default zero; only the turn above uses it.

        Raises:
            FactorError: when [start, stop] reaches outside the samples.
        """
        breaks, force, rate = self._segment_arrays(start, stop, at, bias_vector(bias))
        for segment in zip(force, rate, (breaks[1:] - breaks[:-1]).tolist(), strict=True):
            yield ImuSegment(*segment)

    def _segment_arrays(
        self, start: float, stop: float, at: ArrayLike, b: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Breaks (n + 1,), accelerometer (n, 3) and gyroscope (n, 3) of the n `segments`."""
        start, stop = number("start", start), number("stop", stop)
        if stop < start:
            raise FactorError(f"stop = {stop:.9f} s lies before start = {start:.9f} s")
        if start < self.times[0] - SAME_TIME or stop > self.times[-1] + SAME_TIME:
            raise FactorError(
                f"IMU samples cover {self.times[0]:.9f} to {self.times[-1]:.9f} s, "
                f"but {start:.9f} to {stop:.9f} s is asked for"
            )
        first, last = float(self.times[0]), float(self.times[-1])
        start, stop = min(max(start, first), last), min(max(stop, first), last)
        inside = [time for time in np.asarray(at, dtype=float).tolist() if start <= time <= stop]
        cut = native.segments if active_kernel() == "native" else segments_in_numpy
        return cut(self.times, self.accelerometer, self.gyroscope, [start, stop, *inside], b)


def bias_vector(bias: gtsam.imuBias.ConstantBias | None) -> FloatArray:
    """Accelerometer and gyroscope, (6,); zeros for None."""
    if bias is None:
        return np.zeros(6)
    instance("bias", bias, gtsam.imuBias.ConstantBias)
    return finite_array("bias", bias.vector(), (6,))
