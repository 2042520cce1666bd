# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Weights of lines by their own residuals: folds, shadows and edges that tracks confuse err more
than window frames, and in frame after frame.
"""

from collections.abc import Iterable

import numpy as np

from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.states import Interval, LineObservation

# Residuals of ideal lines are rounding, normalised units squared.
_NO_NOISE = 1e-20


def reweigh(intervals: Iterable[Interval], lines: Iterable[Landmark], prior: float) -> None:
    """Weigh lines anew, and their factors, by the residuals of all intervals.

    The noise variance of line l is lambda_l times that of an ordinary one, lambda_l scaled inverse
    chi-square with `prior` degrees of freedom, so that its points together are distributed as
    Student's t. With s_l^2 the mean square of its residuals in n_l intervals and s_0^2 the median
    of all lines', the weight is

        w_l = min(1, (prior + n_l) / (prior + n_l s_l^2 / s_0^2)).

    None counts for more than the noise figures say: what errs in the same way in all frames does
    not show in residuals.
    The frames of an interval count as one, since the error of an edge changes slowly. What all
    lines have in common, such as blur or an error of the state, does not matter.

    Args:
        intervals: of the window, as estimated.
        lines: of the graph.
        prior: `lines.weight_prior`.

    Source: Lange, Little, Taylor, Robust statistical modeling using the t distribution, Journal of
    the American Statistical Association 84 (1989), whose EM iteration has these weights.
    """
    found = {id(line): line for line in lines}
    seen: dict[int, list[LineObservation]] = {}
    squares: dict[int, float] = {}
    for interval in intervals:
        state = interval.state(np.zeros(4))
        for each in interval.observations:
            line = each.line
            if id(line) not in found or each.factor.spec.line_key != line.key:
                continue
            value = each.factor.evaluate(state._replace(line=line.delta), False).value
            seen.setdefault(id(line), []).append(each)
            squares[id(line)] = squares.get(id(line), 0.0) + float(value @ value)
    if not seen:
        return
    counts = np.array([len(own) for own in seen.values()])
    points = np.array([sum(each.points.weight for each in own) for own in seen.values()])
    mean_squares = np.array([squares[key] for key in seen]) / points
    usual = max(float(np.median(mean_squares)), _NO_NOISE)
    weights = np.minimum(1.0, (prior + counts) / (prior + counts * mean_squares / usual))
    for key, weight in zip(seen, weights.tolist(), strict=True):
        found[key].weight = weight
        for each in seen[key]:
            each.factor.weight = weight
