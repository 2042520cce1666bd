# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of the motion along parallel lines, which only the IMU observes."""

import numpy as np

from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.integrity.gauge import UP


class ParallelLines:
    """How far the position along the lines may have drifted since all are parallel."""

    def __init__(self, config: IntegrityConfig) -> None:
        self._config = config
        self._since: float | None = None
        self._time = 0.0
        self._along = np.zeros(3)
        self._initial_variances: tuple[float, float] = (0.0, 0.0)

    @property
    def for_long(self) -> bool:
        """Whether all lines have been parallel for long."""
        since = self._since
        return since is not None and self._time - since >= self._config.parallel_time

    def update(self, window: Window, variance_factor: float) -> FloatArray:
        """Look at the window's newest state, whose covariances count times `variance_factor`.

        Returns:
            Covariance of the position that remains after the lines were parallel, (3, 3), m^2.
        """
        self._time = window.newest.time
        directions = directions_in_view(window)
        values, vectors = np.linalg.eigh(directions.T @ directions / max(len(directions), 1))
        # Too few lines are another matter, and end nothing.
        if len(directions) < self._config.min_lines:
            return np.zeros((3, 3))
        if values[-1] < 1.0 - self._config.parallel_spread:
            stays, self._since = self.covariance(), None
            return stays
        self._along = vectors[:, -1]
        if self._since is None:
            self._since = self._time
            of_pose, of_velocity, of_bias = (variance_factor * c for c in window.newest.covariances)
            velocity_variance = float(self._along @ of_velocity @ self._along)
            up = window.newest.state.attitude().matrix().T @ UP
            # About the two horizontal axes: yaw turns no gravity.
            tilt = 0.5 * float(np.trace(of_pose[:3, :3]) - up @ of_pose[:3, :3] @ up)
            gravity = float(np.linalg.norm(window.intervals[-1].gravity))
            acceleration_variance = (
                float(np.linalg.eigvalsh(of_bias[:3, :3])[-1]) + gravity**2 * tilt
            )
            self._initial_variances = (velocity_variance, acceleration_variance)
        return np.zeros((3, 3))

    def covariance(self) -> FloatArray:
        """Of the position in the world along the lines, by now, (3, 3), m^2."""
        if self._since is None or not self.for_long:
            return np.zeros((3, 3))
        elapsed = self._time - self._since
        velocity_variance, acceleration_variance = self._initial_variances
        variance = velocity_variance * elapsed**2 + 0.25 * acceleration_variance * elapsed**4
        return variance * np.outer(self._along, self._along)


def directions_in_view(window: Window) -> FloatArray:
    """Unit directions in the world of the window's lines that were seen last, (N, 3)."""
    found = []
    for line in window.lines.values():
        if line.in_view:
            direction = line.plucker[0][3:]
            length = np.linalg.norm(direction)
            if length > 0.0:
                found.append(direction / length)
    return np.array(found).reshape(-1, 3)
