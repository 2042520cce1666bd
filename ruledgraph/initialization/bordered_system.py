# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Normal equations of one state and many lines, each of which meets the state alone."""

from typing import NamedTuple

import numpy as np

from ruledgraph.core.arrays import FloatArray

# Of the diagonal that is damped, as in GTSAM's Levenberg-Marquardt.
_MIN, _MAX = 1e-6, 1e32


class Step(NamedTuple):
    """A change of all variables, and by how much it lowers the cost of the linear problem."""

    state: FloatArray
    """(n,)"""
    lines: FloatArray
    """(N, 4)"""
    gain: float


class BorderedSystem(NamedTuple):
    """A state of n columns with priors, and N lines."""

    information: FloatArray
    """Of the priors, (n, n)."""
    gradient: FloatArray
    """Of the priors, (n,)."""
    of_lines: FloatArray
    """Information of each line by the state and its own four coordinates, (N, n + 4, n + 4)."""
    gradients: FloatArray
    """(N, n + 4)"""

    def step(self, damping: float) -> Step:
        """The Levenberg-Marquardt step: (H + damping diag(H)) step = -gradient, lines eliminated.

        Raises:
            numpy.linalg.LinAlgError: for a system that is indeterminate.
        """
        n = len(self.information)
        H, g = self.information + self.of_lines[:, :n, :n].sum(axis=0), self._state_gradient()
        damped = H + damping * np.diag(np.clip(np.diag(H), _MIN, _MAX))
        own, border = self.of_lines[:, n:, n:].copy(), self.of_lines[:, n:, :n]
        diagonal = np.einsum("nii->ni", own)
        diagonal += damping * np.clip(diagonal, _MIN, _MAX)
        inverse = np.linalg.inv(own)
        by_state = inverse @ border
        rows = border.reshape(-1, n)
        reduced = damped - rows.T @ by_state.reshape(-1, n)
        own_gradients = self.gradients[:, n:, None]
        target = by_state.reshape(-1, n).T @ own_gradients.ravel() - g
        state = np.linalg.solve(reduced, target)
        lines = -(inverse @ own_gradients)[..., 0] - by_state @ state
        # Of the undamped model, -(g . s + s . H s / 2).
        both = np.concatenate([np.broadcast_to(state, (len(lines), n)), lines], axis=1)
        curvature = state @ self.information @ state
        curvature += np.sum((self.of_lines @ both[..., None])[..., 0] * both)
        slope = state @ g + np.sum(lines * self.gradients[:, n:])
        return Step(state, lines, -float(slope + 0.5 * curvature))

    def _state_gradient(self) -> FloatArray:
        return np.asarray(self.gradient + self.gradients[:, : len(self.gradient)].sum(axis=0))

    def line_covariances(self) -> FloatArray:
        """Of each line's coordinates, the state being known, (N, 4, 4).

        Raises:
            numpy.linalg.LinAlgError: when one is indeterminate.
        """
        n = len(self.information)
        return np.asarray(np.linalg.inv(self.of_lines[:, n:, n:]))

    def state_covariance(self, fixed: int = 0) -> FloatArray:
        """Of the state at the solution, by the noise model and by how much the lines disagree.

        The noise model's covariance C = H^-1 counts the points of a line as independent. They are
        not: an edge that is not straight, or not the line that is followed, pulls all of them one
        way. So what the lines, each as a whole, disagree by is added:

            C + C (sum_i a_i a_i^T) C,    a_i = (I - H_i C)^(-1/2) g_i

        with H_i and g_i the information and the gradient of line i after its own variables are
        eliminated. It is the covariance for clustered data with the correction for the share of
        each cluster in the solution (CR2: Bell and McCaffrey, Survey Methodology 28 (2002),
        169-181).

        Args:
            fixed: how many of the last columns count as known.

        Returns:
            (n - fixed, n - fixed).

        Raises:
            numpy.linalg.LinAlgError: when the state is indeterminate.
        """
        n = len(self.information)
        count = n - fixed
        border, own = self.of_lines[:, n:, :count], self.of_lines[:, n:, n:]
        by_line = np.linalg.solve(own, border)
        systems = self.of_lines[:, :count, :count] - border.transpose(0, 2, 1) @ by_line
        pulls = self.gradients[:, :count] - np.einsum("nki,nk->ni", by_line, self.gradients[:, n:])
        information = self.information[:count, :count] + systems.sum(axis=0)
        root = np.linalg.cholesky(np.linalg.inv(information))
        between = np.zeros_like(information)
        for H, g in zip(systems, pulls, strict=True):
            # In coordinates where C is the identity; the rest keeps 1 - share above zero.
            share, axes = np.linalg.eigh(root.T @ H @ root)
            pull = axes @ ((axes.T @ (root.T @ g)) / np.sqrt(np.maximum(1.0 - share, 1e-12)))
            between += np.outer(pull, pull)
        return np.asarray(root @ (np.eye(count) + between) @ root.T)
