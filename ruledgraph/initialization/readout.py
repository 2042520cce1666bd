# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The readout of a rolling shutter, from how images turn and what the gyroscope says."""

from typing import NamedTuple

import numpy as np
from scipy.special import bdtrc

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.rotation_fit import RotationFit
from ruledgraph.initialization.time_offset_finder import RANGE
from ruledgraph_factors import ImuSamples

# Readouts that are compared, s: up to the frame interval of 20 Hz. Time offsets likewise.
_READOUT_STEP = 0.01
_READOUTS = np.arange(0.0, 0.05 + 1e-9, _READOUT_STEP)
_OFFSET_STEP = 0.01
# What the rotations leave out, s: while rows are read the camera moves on, too. In eight rendered
# recordings before a wall the error was 5 ms (RMS).
_UNMODELLED = 5e-3
# A chi^2 of one degree of freedom that no chance gives.
_BETTER = 30.0
# Of the sign test of pairs that are explained better.
_CONFIDENCE = 0.95


class ReadoutEstimate(NamedTuple):
    """What the images say of the readout."""

    value: float
    """s."""
    sigma: float
    """Its standard deviation, s."""
    gain: float
    """By how much it explains the images better than the calibration's, as a chi^2."""
    improved: int
    """So many pairs of images it explains better ..."""
    pairs: int
    """... of so many."""

    @property
    def is_better(self) -> bool:
        """Whether no chance explains the gain."""
        return self.gain > _BETTER

    @property
    def is_certain(self) -> bool:
        """Whether, besides, it is not that of a few pairs which fit badly."""
        by_chance = float(bdtrc(self.improved - 1, self.pairs, 0.5))
        return self.is_better and by_chance < 1.0 - _CONFIDENCE


def estimated_readout(
    pairs: PointPairs,
    samples: ImuSamples,
    calibration: Calibration,
    bias_sigma: float,
    offset: float | None = None,
) -> ReadoutEstimate | None:
    """The readout with which images and gyroscope turn alike best, of a parabola through costs.

    A time offset would move all rows alike: for each readout the best one is found, too.

    Args:
        pairs: of images, with times of the calibration's middle rows, covered by `samples`.
        samples: of the gyroscope.
        calibration: whose readout is compared.
        bias_sigma: standard deviation of the gyroscope's bias, rad/s.
        offset: the time offset, about, s; it is looked for if it is not known.

    Returns:
        None where the motion does not show it.
    """
    given = pairs, samples, calibration, bias_sigma
    about = _likeliest_offset(*given) if offset is None else offset

    def costs_of_pairs(readout: float) -> tuple[FloatArray, float]:
        # The middle row's time hardly depends on the readout.
        later = 0.5 * (readout - calibration.readout)
        moved = pairs._replace(times=pairs.times + later)
        fit = RotationFit(moved, samples, calibration.with_readout(readout), bias_sigma)
        best = fit.linearized(fit.best_at(about - later)).solution()
        found = fit.linearized(best)
        return found.evidence.costs, found.variance

    others = [costs_of_pairs(readout) for readout in _READOUTS.tolist()]
    now, _ = costs_of_pairs(calibration.readout) if calibration.readout else others[0]
    costs = [float(of_pairs.sum()) for of_pairs, _ in others]
    lowest = int(np.argmin(costs))
    middle = min(max(lowest, 1), len(costs) - 2)
    left, here, right = costs[middle - 1 : middle + 2]
    curvature = (left - 2.0 * here + right) / _READOUT_STEP**2
    best, variance = others[lowest]
    if curvature <= 0.0 or not variance > 0.0:
        return None
    slope = 0.5 * (right - left) / _READOUT_STEP
    value = max(float(_READOUTS[middle] - slope / curvature), 0.0)
    if value > _READOUTS[-1]:
        return None
    return ReadoutEstimate(
        value,
        float(np.hypot(np.sqrt(2.0 * variance / curvature), _UNMODELLED)),
        float((now - best).sum()) / variance,
        int(np.sum(best < now)),
        len(now),
    )


def _likeliest_offset(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, bias_sigma: float
) -> float:
    """The time offset with the calibration's readout, of a grid, s."""
    fit = RotationFit(pairs, samples, calibration, bias_sigma)
    offsets = calibration.time_offset + np.arange(-RANGE, RANGE + 1e-9, _OFFSET_STEP)
    return float(offsets[np.argmin(fit.profile(offsets).sum(axis=1))])
