# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's incremental fixed-lag smoother: the only module that touches it and its failures."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import WindowConfig
from ruledgraph.core.errors import RuledgraphError


class SmootherError(RuledgraphError):
    """The system is indeterminate or the estimate diverged."""


class Removal(NamedTuple):
    """Python factors that are to be removed."""

    variables: set[int]
    """All on any of these."""
    factors: list[gtsam.CustomFactor]
    """And these very objects."""

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self.variables or self.factors)

    def indices(self, graph: gtsam.NonlinearFactorGraph) -> list[int]:
        """Of those that a graph has."""
        ids = {id(factor) for factor in self.factors}
        factors = ((i, graph.at(i)) for i in range(graph.size()))
        return [
            i
            for i, factor in factors
            if id(factor) in ids
            or (
                self.variables
                and isinstance(factor, gtsam.CustomFactor)
                and not self.variables.isdisjoint(factor.keys())
            )
        ]


class FixedLagSmoother:
    """iSAM2 over the last `lag` seconds.

    It takes Gauss-Newton steps with Cholesky factorisation, which is fast. When such a step fails,
    as after long dead reckoning, its factors and variables go to a new iSAM2 with Dogleg steps and
    QR, and back to a fast one some updates later.

    Args:
        config: lag, updates and when variables are linearised anew.
        dogleg: begin with Dogleg steps and QR.
    """

    def __init__(self, config: WindowConfig, dogleg: bool = False) -> None:
        self._config = config
        self._times: dict[int, float] = {}
        self.dogleg_reason = ""
        """The error for which it last changed to Dogleg steps."""
        self._begin(dogleg)

    def _begin(self, dogleg: bool) -> None:
        params = gtsam.ISAM2Params()
        params.setRelinearizeThreshold(self._config.relinearize)
        params.relinearizeSkip = 1
        params.findUnusedFactorSlots = True
        if dogleg:
            params.setOptimizationParams(gtsam.ISAM2DoglegParams())
            params.setFactorization("QR")
        self._dogleg_for = self._config.dogleg_updates if dogleg else 0
        self._smoother = gtsam.IncrementalFixedLagSmoother(self._config.lag, params)
        # As long as Python holds it, callbacks are given this very object: without, pybind copies
        # all variables for every callback, which takes as long as the callback itself.
        self._linearization_point = self.linearization_point()

    @property
    def dogleg(self) -> bool:
        """Whether it takes Dogleg steps with QR now."""
        return self._dogleg_for > 0

    @property
    def factors(self) -> gtsam.NonlinearFactorGraph:
        """All that are not marginalised, and the marginals."""
        return self._smoother.getFactors()

    def update(
        self,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        times: Mapping[int, float],
        check: Callable[[gtsam.Values], bool],
        removal: Removal | None = None,
    ) -> gtsam.Values:
        """Add factors and variables, and the times of new and of refreshed variables.

        Args:
            factors: new ones.
            values: of the new variables.
            times: of new and of refreshed variables, s.
            check: whether an estimate is about what was expected, so that no further step is
                needed; raises `SmootherError` for one that cannot be right.
            removal: factors to be removed; each of their variables must have another one.

        Returns:
            The estimate of all variables.

        Raises:
            SmootherError: when Dogleg steps fail, too; the smoother cannot be used any more.
        """
        # Copies: what GTSAM hands out changes with the smoother, also in an update that fails.
        factors_before = gtsam.NonlinearFactorGraph(self.factors)
        removed = removal.indices(factors_before) if removal else []
        for index in removed:
            factors_before.remove(index)
        values_before = gtsam.Values(self.linearization_point())
        # With the times of this update a new smoother would at once drop variables that the new
        # factors need.
        times_before = {key: self._times[key] for key in values_before.keys()}  # noqa: SIM118
        before = factors_before, values_before, times_before
        self._times = times_before | dict(times)
        was_dogleg = self.dogleg
        self._dogleg_for = max(0, self._dogleg_for - 1)
        if not self.dogleg:
            try:
                if was_dogleg:
                    self._restart(*before, dogleg=False)
                    removed = []
                return self._solve(factors, values, times, check, removed)
            except SmootherError as failure:
                self.dogleg_reason = str(failure)
                self._restart(*before, dogleg=True)
                removed = []
        return self._solve(factors, values, times, check, removed)

    def _solve(
        self,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        times: Mapping[int, float],
        check: Callable[[gtsam.Values], bool],
        removed: Sequence[int],
    ) -> gtsam.Values:
        self._call(factors, values, times, removed)
        estimate, left = self._smoother.calculateEstimate(), self._config.updates
        while not check(estimate) and left > 0:
            # The pre-release of GTSAM 4.3 has no update without arguments.
            self._call(gtsam.NonlinearFactorGraph(), gtsam.Values(), {})
            estimate, left = self._smoother.calculateEstimate(), left - 1
        return estimate

    def _call(
        self,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        times: Mapping[int, float],
        removed: Sequence[int] = (),
    ) -> None:
        try:
            # GTSAM's stub wants a mapping whose key type is exactly its own.
            self._smoother.update(factors, values, times, list(removed))  # type: ignore[arg-type]
        except (RuntimeError, IndexError, ValueError) as error:
            raise SmootherError(" ".join(str(error).split())[:300]) from None

    def _restart(
        self,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        times: Mapping[int, float],
        dogleg: bool,
    ) -> None:
        """Replace the smoother by one with these factors and variables."""
        kept = gtsam.NonlinearFactorGraph()
        for i in range(factors.size()):
            factor = factors.at(i)
            if isinstance(factor, gtsam.LinearContainerFactor):
                # A marginal does not store where it was linearised: at that point of its variables.
                factor = gtsam.LinearContainerFactor(factor.linearize(values), values)
            if factor is not None:
                kept.push_back(factor)
        self._begin(dogleg)
        self._call(kept, values, times)

    def linearization_point(self) -> gtsam.Values:
        """Where each variable's factors are linearised."""
        smoother = self._smoother
        # The pre-release of GTSAM 4.3 has it in iSAM2 alone, of which this makes a copy.
        has_it = hasattr(smoother, "getLinearizationPoint")
        return (smoother if has_it else smoother.getISAM2()).getLinearizationPoint()

    def joint_covariance(self, keys: Sequence[int]) -> FloatArray | None:
        """Marginal covariance of several variables together, in their order; None when it cannot
        be computed.
        """
        try:
            isam = self._smoother.getISAM2()
            if hasattr(isam, "jointMarginalCovariance"):
                joint = isam.jointMarginalCovariance(list(keys))
                blocks = [[joint.at(i, j) for j in keys] for i in keys]
                found = np.block(blocks)
            else:  # the pre-release of GTSAM 4.3: without what lies between the variables
                from scipy.linalg import block_diag

                found = block_diag(*(self._smoother.marginalCovariance(key) for key in keys))
        except (RuntimeError, IndexError):
            return None
        return np.asarray(found) if np.isfinite(found).all() else None
