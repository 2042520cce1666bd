# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance of a batch's state: by the noise model, and by how much the lines disagree."""

from collections.abc import Sequence

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray


def state_covariance(
    graph: gtsam.GaussianFactorGraph, state_keys: Sequence[int], fixed: int
) -> FloatArray:
    """Of the state, from a graph linearised at its solution, whose other variables are lines.

    The noise model's covariance C = H^-1 counts the points of a line as independent. They are not:
    an edge that is not straight, or not the line that is followed, pulls all of them one way. So
    what the lines, each as a whole, disagree by is added:

        C + C (sum_i a_i a_i^T) C,    a_i = (I - H_i C)^(-1/2) g_i

    with H_i and g_i the information and the gradient of line i after its own variables are
    eliminated. It is the covariance for clustered data with the correction for the share of each
    cluster in the solution (CR2: Bell and McCaffrey, Survey Methodology 28 (2002), 169-181).

    Args:
        graph: of the factors; those of a line have its key and those of the state.
        state_keys: of the variables that are asked for, in this order.
        fixed: how many of the last columns count as known.

    Returns:
        (n, n), n the columns of `state_keys` less `fixed`.

    Raises:
        RuntimeError, numpy.linalg.LinAlgError: when the state is indeterminate.
    """
    ordering = gtsam.Ordering()
    for key in state_keys:
        ordering.push_back(key)
    of_lines: dict[int, gtsam.GaussianFactorGraph] = {}
    others = gtsam.GaussianFactorGraph()
    for n in range(graph.size()):
        factor = graph.at(n)
        lines = set(factor.keys()) - set(state_keys)
        own = of_lines.setdefault(lines.pop(), gtsam.GaussianFactorGraph()) if lines else others
        own.push_back(factor)
    information = others.hessian(ordering)[0]
    count = len(information) - fixed
    information = information[:count, :count]
    systems = []
    own_columns = slice(count + fixed, None)
    for line, own in of_lines.items():
        line_last = gtsam.Ordering(ordering)
        line_last.push_back(line)
        H, g = own.hessian(line_last)
        by_line = np.linalg.solve(H[own_columns, own_columns], H[own_columns, :count])
        left = H[:count, :count] - H[:count, own_columns] @ by_line
        systems.append((left, g[:count] - g[own_columns] @ by_line))
        information = information + left
    root = np.linalg.cholesky(np.linalg.inv(information))
    between = np.zeros_like(information)
    for H, g in systems:
        # In coordinates where C is the identity; the rest of the graph keeps 1 - share above zero.
        share, axes = np.linalg.eigh(root.T @ H @ root)
        pull = axes @ ((axes.T @ (root.T @ g)) / np.sqrt(np.maximum(1.0 - share, 1e-12)))
        between += np.outer(pull, pull)
    return np.asarray(root @ (np.eye(count) + between) @ root.T)
