# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How much larger or smaller the noise is than the window takes it for, by the innovations."""

import math
from collections import deque
from typing import NamedTuple

from scipy.special import fdtri, ndtr, stdtrit

from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Innovation

# Standard deviations that an error is held against.
_SIGMAS = 3.0


class _InnovationSum(NamedTuple):
    """Faded sums over innovations, the prediction of each of which begins where the one before
    ended.
    """

    time: float
    nis: float
    dof: float

    def faded(self, time: float, memory: float) -> "_InnovationSum":
        kept = math.exp((self.time - time) / memory)
        return _InnovationSum(time, kept * self.nis, kept * self.dof)

    def quantile(self, prior: float, dof: int, confidence: float) -> float:
        """The largest sum of squares over so many degrees of freedom, with a confidence. Noise as
        the figures say is no surprise, however small it was before.
        """
        known = prior + self.dof
        expected = max(1.0, (prior + self.nis) / known)
        return dof * expected * float(fdtri(dof, known, confidence))


_EMPTY = _InnovationSum(0.0, 0.0, 0.0)


class VarianceFactor:
    """The factor s^2 of all variances, of IMU and edges alike: the variance of unit weight.

    The estimate is the same whatever s^2 is, its covariance is proportional to it (but for the
    robust loss, whose scale is in pixels, and what is left of the priors of a start). With the
    noise figures counting as `prior` degrees of freedom of s^2 = 1, and innovations of nis_k over
    dof_k degrees of freedom, s^2 is scaled inverse chi-square, and an estimate whose covariance is
    s^2 C is distributed as Student's t with n degrees of freedom. The covariance that is reported
    is that of a Gaussian with the same three-sigma bounds: with t the quantile of Student's t at
    the probability of three standard deviations of a Gaussian,

        C (t / 3)^2 (prior + sum w_k nis_k) / n,    n = prior + sum w_k dof_k.

    Innovations of states whose predictions began while another one's went on share its errors: the
    newest one counts, the one that ended when the newest one's prediction began, and so on, which
    are independent, the older the less. Those predicted from states of a start on trial show what
    the start is worth, not what noise there is: they count while they are the newest.

    Source: Gelman et al., Bayesian Data Analysis (3rd edition, 2013), 3.2; Mikhail and Ackermann,
    Observations and Least Squares (1976), a posteriori variance factor.

    Args:
        config: `variance_prior` and `variance_memory`.
        counts_from: when a start was accepted, s.
    """

    def __init__(self, config: IntegrityConfig, counts_from: float = -math.inf) -> None:
        self._prior = config.variance_prior
        self._memory = config.variance_memory
        self._sums: deque[_InnovationSum] = deque()
        self._newest = _EMPTY
        self.counts_from = counts_from
        """Innovations whose predictions began before count while they are the newest, s."""

    @property
    def estimate(self) -> float:
        """The a posteriori variance factor, one over the mean of 1 / s^2."""
        return (self._prior + self._newest.nis) / (self._prior + self._newest.dof)

    @property
    def of_covariances(self) -> float:
        """The reported covariance over C."""
        t = float(stdtrit(self._prior + self._newest.dof, ndtr(_SIGMAS)))
        return self.estimate * (t / _SIGMAS) ** 2

    def quantile(self, dof: int, confidence: float) -> float:
        """The largest sum of squares over so many degrees of freedom, with a confidence, by the
        noise figures and what is known of s^2.
        """
        return self._newest.quantile(self._prior, dof, confidence)

    def is_unlikely(self, innovation: Innovation, time: float, confidence: float) -> bool:
        """Whether an innovation needs more noise than the figures and those before it show.

        An F-test: with s^2 of n degrees of freedom by these, (nis / dof) / s^2 ~ F(dof, n).

        Args:
            innovation: of a state, not taken in yet.
            time: of this state, s.
            confidence: with which it is unlikely.
        """
        before = self._before(innovation, time)
        return innovation.nis > before.quantile(self._prior, innovation.dof, confidence)

    def update(self, innovation: Innovation | None, time: float) -> None:
        """Take in the innovation of a state at a time, s."""
        if innovation is None:
            last = self._sums[-1] if self._sums else _EMPTY
            self._newest = last.faded(time, self._memory)
            return
        before = self._before(innovation, time)
        self._newest = _InnovationSum(
            time, innovation.nis + before.nis, innovation.dof + before.dof
        )
        if innovation.since >= self.counts_from:
            self._sums.append(self._newest)

    def _before(self, innovation: Innovation, time: float) -> _InnovationSum:
        """The sum before the prediction began of which this is, faded until a time, s."""
        sums = self._sums
        while len(sums) > 1 and sums[1].time <= innovation.since:
            sums.popleft()
        if sums and sums[0].time <= innovation.since:
            return sums[0].faded(time, self._memory)
        return _InnovationSum(time, 0.0, 0.0)
