# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A rolling shutter's readout: does it fit between the frames, and do the images speak for it?"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.diagnostics.checks import Finding
from ruledgraph.initialization.clock_offset import RANGE
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.rotation_fit import RotationFit
from ruledgraph_factors import ImuSamples

# Readouts that are compared, s: up to the frame interval of 20 Hz. Clock offsets likewise.
_READOUT_STEP = 0.005
_READOUTS = np.arange(0.0, 0.05 + 1e-9, _READOUT_STEP)
_OFFSET_STEP = 0.01
# What the rotations leave out, s: while rows are read the camera moves on, too. In eight rendered
# recordings before a wall the error was 5 ms (RMS).
_UNMODELLED = 5e-3
# Another readout is told when it explains the images much better, a chi^2 of one degree of freedom
# that no chance gives, and when it is so far from the calibration's that it matters, s.
_BETTER, _LARGE = 30.0, 0.005


def examine_readout(calibration: Calibration, frame_times: FloatArray) -> Iterator[Finding]:
    """What the calibration says of the rows' times.

    Args:
        calibration: as read.
        frame_times: of the recording, s.
    """
    readout = calibration.readout
    if not readout:
        return
    interval = float(np.median(np.diff(frame_times))) if len(frame_times) > 1 else np.inf
    if readout > interval:
        yield Finding(
            False,
            f"rows are read within {1e3 * readout:.1f} ms, but frames are {1e3 * interval:.1f} ms "
            "apart; line_delay is in s per row, --readout in s",
        )
    else:
        yield Finding(True, f"a rolling shutter: rows are read within {1e3 * readout:.1f} ms")


class ReadoutEstimate(NamedTuple):
    """What the images say of the readout."""

    value: float
    """s."""
    sigma: float
    """Its standard deviation, s."""
    gain: float
    """By how much it explains the images better than the calibration's, as a chi^2."""


def estimated_readout(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, bias_sigma: float
) -> ReadoutEstimate | None:
    """The readout with which images and gyroscope turn alike best, of a parabola through costs.

    A clock offset would move all rows alike: for each readout the best one is found, too.

    Args:
        pairs: of images, with times of the calibration's middle rows, covered by `samples`.
        samples: of the gyroscope.
        calibration: whose readout is compared.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.

    Returns:
        None where the motion does not show it.
    """
    fit = RotationFit(pairs, samples, calibration, bias_sigma)
    offsets = calibration.time_offset + np.arange(-RANGE, RANGE + 1e-9, _OFFSET_STEP)
    offset = float(offsets[np.argmin(fit.profile(offsets).sum(axis=1))])

    def cost(readout: float) -> tuple[float, float]:
        # The middle row's time hardly depends on the readout.
        later = 0.5 * (readout - calibration.readout)
        moved = pairs._replace(times=pairs.times + later)
        fit = RotationFit(moved, samples, calibration.with_readout(readout), bias_sigma)
        best = fit.linearized(fit.best_at(offset - later)).solution()
        found = fit.linearized(best)
        return float(found.evidence.costs.sum()), found.variance

    costs = [cost(readout) for readout in (calibration.readout, *_READOUTS.tolist())]
    (now, _), *others = costs
    lowest = int(np.argmin([cost for cost, _ in others]))
    middle = min(max(lowest, 1), len(others) - 2)
    left, here, right = (others[middle + i][0] for i in (-1, 0, 1))
    curvature = (left - 2.0 * here + right) / _READOUT_STEP**2
    variance = others[lowest][1]
    if curvature <= 0.0 or not variance > 0.0:
        return None
    slope = 0.5 * (right - left) / _READOUT_STEP
    value = max(float(_READOUTS[middle] - slope / curvature), 0.0)
    if value > _READOUTS[-1]:
        return None
    return ReadoutEstimate(
        value,
        float(np.hypot(np.sqrt(2.0 * variance / curvature), _UNMODELLED)),
        (now - others[lowest][0]) / variance,
    )


def compare_readout(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, bias_sigma: float
) -> Iterator[Finding]:
    """Whether the images speak for another readout than the calibration's; as that is estimated."""
    found = estimated_readout(pairs, samples, calibration, bias_sigma)
    if found is None or found.gain < _BETTER or abs(found.value - calibration.readout) < _LARGE:
        return
    line_delay = calibration.with_readout(found.value).line_delay
    yield Finding(
        False,
        f"the images fit the gyroscope best with rows read within {1e3 * found.value:.0f} ms "
        f"(standard deviation {1e3 * found.sigma:.0f} ms), the calibration says "
        f"{1e3 * calibration.readout:.0f} ms; try --readout {found.value:.3f}, or write "
        f"line_delay: {line_delay:.2e}",
    )
