# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How much larger the noise is than its figures say, by the innovations."""

import math

from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Innovation


class VarianceFactor:
    """The factor s^2 of all variances, of IMU and edges alike: the variance of unit weight.

    The estimate is the same whatever s^2 is, its covariance is proportional to it (but for the
    robust loss, whose scale is in pixels, and what is left of the priors of a start). With the
    noise figures counting as `prior` degrees of freedom of s^2 = 1, and innovations of nis_k over
    dof_k degrees of freedom, its mean is about

        s^2 = (prior + sum w_k nis_k) / (prior + sum w_k dof_k).

    Innovations are of a window: of the n states in one, each tells a share w_k = 1 / n, and it is
    forgotten with time.

    Source: Mikhail and Ackermann, Observations and Least Squares (1976), a posteriori variance
    factor.

    Args:
        config: `variance_prior` and `variance_memory`.
        window: length of one, s.
    """

    def __init__(self, config: IntegrityConfig, window: float) -> None:
        self._prior = config.variance_prior
        self._memory = config.variance_memory
        self._window = window
        self._nis = self._dof = 0.0

    def update(self, innovation: Innovation | None, elapsed: float) -> float:
        """The factor when so much time (s) has passed to a state with this innovation."""
        kept = math.exp(-elapsed / self._memory)
        self._nis, self._dof = kept * self._nis, kept * self._dof
        if innovation is not None:
            share = min(elapsed / self._window, 1.0)
            self._nis += share * innovation.nis
            self._dof += share * innovation.dof
        return (self._prior + self._nis) / (self._prior + self._dof)
