# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's incremental fixed-lag smoother: the only module that touches it and its failures."""

from collections.abc import Mapping

import gtsam
import numpy as np

from ruledgraph.errors import RuledgraphError
from ruledgraph.sensors import FloatArray

# Estimates that move by less than this are not linearised anew (rad, m, m/s, ...).
_RELINEARIZE = 1e-3


class SmootherError(RuledgraphError):
    """The system is indeterminate or the estimate ran away."""


class FixedLagSmoother:
    """iSAM2 over the last `lag` seconds."""

    def __init__(self, lag: float, updates: int) -> None:
        params = gtsam.ISAM2Params()
        params.setRelinearizeThreshold(_RELINEARIZE)
        params.relinearizeSkip = 1
        # Gauss-Newton runs away when lines that rested without a depth begin to move.
        params.setOptimizationParams(gtsam.ISAM2DoglegParams())
        params.findUnusedFactorSlots = True
        # Biases are a million times as certain as a new line: Cholesky calls that indeterminate.
        params.setFactorization("QR")
        self._smoother = gtsam.IncrementalFixedLagSmoother(lag, params)
        self._updates = updates

    def update(
        self,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        times: Mapping[int, float],
    ) -> gtsam.Values:
        """Add factors and variables, and the times of new and of refreshed variables.

        Raises:
            SmootherError: when GTSAM cannot solve the system or the estimate is not finite.
        """
        try:
            # GTSAM's stub wants a mapping whose key type is exactly its own.
            self._smoother.update(factors, values, times)  # type: ignore[arg-type]
            for _ in range(self._updates):
                # The pre-release of GTSAM 4.3 has no update without arguments.
                self._smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), {})
            estimate = self._smoother.calculateEstimate()
        except (RuntimeError, IndexError, ValueError) as error:
            raise SmootherError(" ".join(str(error).split())[:300]) from None
        return estimate

    def covariance(self, key: int) -> FloatArray | None:
        """Marginal covariance of a variable, None when it cannot be computed."""
        try:
            return np.asarray(self._smoother.marginalCovariance(key))
        except (RuntimeError, IndexError):
            return None
