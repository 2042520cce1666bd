# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the IMU's biases jumped in the newest interval: an acceleration or a rate that the images
do not show, such as a knock, a lift, or a sensor that warms up.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.special import bdtrc

from ruledgraph.backend.line_factors import EdgeModel
from ruledgraph.backend.states import Interval, LineObservation
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph_factors.ruled_surface import LINE_COLUMNS

JUMP_DOF = 6
"""Accelerometer and gyroscope, three axes each."""
# Of the reweighted least squares, which end where the cost changes by less.
_MAX_ITERATIONS, _CONVERGED = 20, 1e-3
# Scale of a loss that is not robust, in standard deviations.
_QUADRATIC = 1e4


class JumpTest(NamedTuple):
    """Of whether the biases jumped."""

    ratio: float
    """Log of the likelihood ratio, doubled: without a jump, but for the loss, a chi-square of six
    degrees of freedom at most (of `rest_jump` three), times the variance factor."""
    jump: FloatArray
    """The most likely one, accelerometer first, (6,)."""
    jumped: bool
    """Whether they did."""


class _Fit(NamedTuple):
    """Of an error x of the state before."""

    cost: float
    """Minus twice the log of its likelihood."""
    x: FloatArray
    squares: FloatArray
    """Squared norm of each line's points from it, in units of its loss's scale."""


class _Lines(NamedTuple):
    """Lines against their points, by an error x of the state before: |value + jacobian x|^2 of each
    with a Cauchy loss.
    """

    value: FloatArray
    """Whitened, of all lines one after another, (rows,)."""
    jacobian: FloatArray
    """(rows, 15)."""
    begins: NDArray[np.int64]
    """First row of each line."""
    scale2: FloatArray
    """Of each line's loss, squared."""

    def fitted(self, covariance: FloatArray) -> _Fit:
        """To the most likely x ~ N(0, covariance).

        By iteratively reweighted least squares, which begin with equal weights: lines that all miss
        by much agree with each other, not with the state.
        """
        information = cho_solve(cho_factor(covariance), np.eye(15))
        rows = np.diff(np.append(self.begins, len(self.value)))
        weights = np.ones(len(self.begins))
        none = np.zeros(15)
        found = [self._at(none, information)]
        for _ in range(_MAX_ITERATIONS):
            weighted = np.repeat(weights, rows)[:, None] * self.jacobian
            normal = cho_factor(information + weighted.T @ self.jacobian)
            x = -cho_solve(normal, weighted.T @ self.value)
            found.append(self._at(x, information))
            if abs(found[-1].cost - found[-2].cost) < _CONVERGED:
                break
            weights = 1.0 / (1.0 + found[-1].squares)
        return min(found, key=lambda one: one.cost)

    def _at(self, x: FloatArray, information: FloatArray) -> _Fit:
        of_rows = np.square(self.value + self.jacobian @ x)
        squares = np.add.reduceat(of_rows, self.begins) / self.scale2
        cost = float(self.scale2 @ np.log1p(squares) + x @ information @ x)
        return _Fit(cost, x, squares)


def bias_jump(
    interval: Interval,
    seen: Sequence[LineObservation],
    model: EdgeModel,
    threshold: float,
    config: Config,
) -> JumpTest | None:
    """A likelihood ratio test of whether the biases jumped; None without lines.

    Of two hypotheses: the state before the interval is off by x ~ N(0, P), its marginal covariance;
    or its biases are, besides, as unknown as before a start. Lines count with their marginal
    covariances, if their distances are known: else their errors are those of one prior. The ratio
    is that of the maxima over x,

        2 log(p_jump / p_none).

    With a threshold of -inf they jumped in any case. Else they did where it is larger than by
    chance, and where most lines fit better with a jump, by a sign test
    (`integrity.jump_confidence`): a few that moved, or were taken for others, make the ratio as
    large. The innovation of the state does not show what this does: with a robust loss lines that
    all contradict the IMU are outliers, and the state stays where it was predicted.

    Args:
        interval: the newest one, its state not corrected by it yet.
        seen: lines in it that were estimated without it.
        model: of their points.
        threshold: of the ratio by chance; -inf: an innovation has shown that they jumped.
        config: all settings; `start` says what is known of biases before one.

    Source: Willsky and Jones, A generalized likelihood ratio approach to the detection and
    estimation of jumps in linear systems, IEEE Transactions on Automatic Control 21 (1976).
    """
    known = interval.node.covariance
    seen = [each for each in seen if each.line.inverse_distance().is_known]
    if not seen:
        return None
    needed = config.integrity.jump_confidence
    unknown = known + block_diag(np.zeros((9, 9)), np.diag(np.square(config.start.bias_sigmas)))
    try:
        lines = _whitened(interval, seen, model)
        none, jump = lines.fitted(known), lines.fitted(unknown)
    except np.linalg.LinAlgError:  # no covariance: the smoother has failed
        return None
    ratio, better = none.cost - jump.cost, int(np.sum(jump.squares < none.squares))
    by_chance = float(bdtrc(better - 1, len(seen), 0.5))
    jumped = threshold == -math.inf or (ratio > threshold and by_chance < 1.0 - needed)
    return JumpTest(ratio, jump.x[9:], jumped)


def _whitened(interval: Interval, seen: Sequence[LineObservation], model: EdgeModel) -> _Lines:
    values, jacobians, scales = [], [], []
    state = interval.state(np.zeros(4))
    for observation in seen:
        line = observation.line
        found = observation.factor.evaluate(state._replace(line=line.delta), True)
        assert found.jacobian is not None  # noqa: S101 - it was asked for
        sigma = model.sigma / math.sqrt(line.weight)
        by_line = found.jacobian[:, LINE_COLUMNS] / sigma
        root = np.linalg.cholesky(np.eye(len(by_line)) + by_line @ line.covariance @ by_line.T)
        by_state = np.column_stack([found.value, found.jacobian[:, :15]]) / sigma
        white = np.linalg.solve(root, by_state)
        values.append(white[:, 0])
        jacobians.append(white[:, 1:])
        scale = model.cauchy_scale / model.sigma or _QUADRATIC
        scales.append(scale**2 * observation.points.weight)
    begins = np.cumsum([0, *(len(value) for value in values[:-1])])
    return _Lines(np.concatenate(values), np.concatenate(jacobians), begins, np.array(scales))
