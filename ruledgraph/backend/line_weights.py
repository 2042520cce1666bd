# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Weights of lines by their residuals: folds, shadows and edges that tracks confuse err more than
window frames, in frame after frame, and those of one camera more than those of another.
"""

from collections.abc import Iterable

import numpy as np

from ruledgraph.backend.edge_noise import edge_variance
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.states import Interval, LineObservation
from ruledgraph.core.config import Config
from ruledgraph_factors.ruled_surface import State

# Residuals of ideal lines are rounding, normalised units squared.
_NO_NOISE = 1e-20
# Of a line, and of a window's first state, to which the IMU ties the others.
_LINE_DOF, _STATE_DOF = 4.0, 15.0


class _Line:
    """A line's residuals."""

    def __init__(self, line: Landmark) -> None:
        self.line = line
        self.seen: list[LineObservation] = []
        self.squares = 0.0
        self.points = 0.0
        self.moving = 0.0
        """Squares of intervals in which the body moved."""
        self.moving_dof = 0.0

    def add(self, observation: LineObservation, state: State, still: bool) -> None:
        """An interval's."""
        value = observation.factor.evaluate(state._replace(line=self.line.delta), False).value
        squares = float(value @ value)
        self.seen.append(observation)
        self.squares += squares
        self.points += observation.points.weight
        if not still:
            self.moving += squares
            self.moving_dof += observation.points.degrees_of_freedom

    def weigh(self, weight: float) -> None:
        """The line and its factors."""
        self.line.weight = weight
        for each in self.seen:
            each.factor.weight = weight


class LineWeights:
    """Weighs lines, and their factors, by the residuals of a window.

    The noise variance of line l is lambda_l s^2 times that of `edges.sigma_px`: s^2 is the camera's
    (see `edge_variance`), lambda_l scaled inverse chi-square with nu (`lines.weight_prior`) degrees
    of freedom, so that its points together are distributed as Student's t. With s_l^2 the mean
    square of its residuals in n_l intervals and s_0^2 the median of all lines', the weight is

        w_l = min(1, (nu + n_l) / (nu + n_l s_l^2 / s_0^2)) / s^2.

    None counts for more than usual: what errs in the same way in all frames does not show in
    residuals. For the same reason s^2 is of intervals in which the body moved.
    The frames of an interval count as one, since the error of an edge changes slowly.

    Args:
        sigma: `edges.sigma_px` in normalised units.
        edge_variance: s^2, as a start has found it.
        config: `lines.weight_prior` and `edges`.

    Source: Lange, Little, Taylor, Robust statistical modeling using the t distribution, Journal of
    the American Statistical Association 84 (1989), whose EM iteration has these weights and this
    s^2, but for its prior.
    """

    def __init__(self, sigma: float, edge_variance: float, config: Config) -> None:
        self._sigma = sigma
        self._prior = config.lines.weight_prior
        self._edges = config.edges
        self.edge_variance = edge_variance
        """s^2."""

    @property
    def new_line_weight(self) -> float:
        """The weight of a line that was not seen yet."""
        return 1.0 / self.edge_variance

    def update(self, intervals: Iterable[Interval], lines: Iterable[Landmark]) -> None:
        """Weigh the lines of the graph anew, by the intervals of the window as estimated."""
        found = {id(line): _Line(line) for line in lines}
        for interval in intervals:
            state = interval.state(np.zeros(4))
            for each in interval.observations:
                own = found.get(id(each.line))
                if own is not None:
                    own.add(each, state, interval.still)
        known = [own for own in found.values() if own.seen]
        if not known:
            return
        counts = np.array([len(own.seen) for own in known])
        mean_squares = np.array([own.squares / own.points for own in known])
        usual = max(float(np.median(mean_squares)), _NO_NOISE)
        prior = self._prior
        weights = np.minimum(1.0, (prior + counts) / (prior + counts * mean_squares / usual))
        dof = sum(own.moving_dof - _LINE_DOF for own in known if own.moving_dof > 0.0) - _STATE_DOF
        if dof > 0.0:
            squares = float(weights @ [own.moving for own in known]) / self._sigma**2
            self.edge_variance = edge_variance(squares, dof, self._edges)
        for own, weight in zip(known, weights.tolist(), strict=True):
            own.weigh(weight / self.edge_variance)
