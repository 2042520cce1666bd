# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Levenberg-Marquardt for the batch of a first window.

GTSAM's would call back into Python for every line at every step; here the native kernel linearises
all lines in one call, and they are eliminated together.
"""

from ruledgraph.initialization.batch_problem import BatchProblem, Estimate

# As GTSAM's, with damping by the diagonal: the priors are stiff.
_FIRST_DAMPING, _FACTOR, _MAX_DAMPING = 1e-5, 10.0, 1e10
# A step is taken that lowers the cost by this share of what its linear model promises.
_MIN_FIDELITY = 1e-3
# Relative decrease of the cost at which it is done.
_TOLERANCE = 1e-4


def minimized(problem: BatchProblem, start: Estimate, iterations: int) -> Estimate:
    """A local minimum of the cost, or how far so many steps came.

    Raises:
        numpy.linalg.LinAlgError: for a system that is indeterminate.
    """
    at, cost, damping = start, problem.cost(start), _FIRST_DAMPING
    for _ in range(iterations):
        system = problem.linearize(at)
        while True:
            step = system.step(damping)
            tried = at.moved(step.state, step.lines)
            lowered = cost - problem.cost(tried)
            if lowered > _MIN_FIDELITY * step.gain > 0.0:
                break
            damping *= _FACTOR
            if damping > _MAX_DAMPING or abs(lowered) < _TOLERANCE * cost:
                return at
        at, cost, damping = tried, cost - lowered, damping / _FACTOR
        if lowered < _TOLERANCE * (cost + lowered):
            break
    return at
