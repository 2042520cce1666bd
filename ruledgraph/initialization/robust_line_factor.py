# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A line's edge points in a window, with a robust loss for every few frames."""

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.core.arrays import FloatArray
from ruledgraph_factors import RuledSurfaceFactor

_ROWS = 3  # of a frame


class RobustLineFactor(gtsam.CustomFactor):
    """One factor in place of one for each chunk of frames: GTSAM calls back far less often.

    With the whitened residual r_c of chunk c and its Jacobian J_c, the Cauchy loss rho_c and its
    weight w_c = 1 / (1 + |r_c|^2 / k_c^2) the residual has the rows sqrt(w_c) r_c and one more,

        z_c = sqrt(2 rho_c - w_c |r_c|^2),

    with the Jacobian sqrt(w_c) J_c and 0. Its error is the sum of the losses; gradient and
    information are those of least squares that are weighted anew at every step, as of a factor for
    each chunk with GTSAM's robust noise.

    Args:
        surface: the line's factor over all its frames; its noise model is not used.
        sigma: standard deviation of a point, normalised units.
        chunk: frames of the line that share one loss.
        scales: k_c, in standard deviations, of each chunk.
    """

    def __init__(
        self, surface: RuledSurfaceFactor, sigma: float, chunk: int, scales: FloatArray
    ) -> None:
        self.surface = surface
        error = _RobustError(surface, sigma, chunk, scales)
        noise = noiseModel.Unit.Create(surface.spec.rows + len(scales))
        super().__init__(noise, list(surface.spec.keys), error)


class _RobustError:
    """The callback, which holds no reference to its factor: that would be a cycle through C++."""

    def __init__(
        self, surface: RuledSurfaceFactor, sigma: float, chunk: int, scales: FloatArray
    ) -> None:
        rows = surface.spec.rows
        self._surface = surface
        self._precision = 1.0 / sigma
        self._starts = np.arange(0, rows, _ROWS * chunk)
        self._lengths = np.diff(np.append(self._starts, rows))
        self._squared_scales = np.square(scales)

    def __call__(
        self, _: gtsam.CustomFactor, values: gtsam.Values, H: list[FloatArray] | None
    ) -> FloatArray:
        residual = self._precision * self._surface.residual(values, H)
        ratio = np.add.reduceat(residual * residual, self._starts) / self._squared_scales
        weight = 1.0 / (1.0 + ratio)
        roots = np.repeat(np.sqrt(weight), self._lengths)
        if H is not None:
            by_row = self._precision * roots[:, None]
            for i in range(len(H)):
                rows = np.zeros((len(roots) + len(ratio), H[i].shape[1]), order="F")
                rows[: len(roots)] = by_row * H[i]
                H[i] = rows
        rest = self._squared_scales * (np.log1p(ratio) - weight * ratio)
        return np.concatenate([roots * residual, np.sqrt(np.maximum(rest, 0.0))])
