# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Priors of a start, and the free choice of position and yaw."""

from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray

# Position and yaw of the first pose are the world's choice: held this tightly (rad, m).
_GAUGE = 1e-4


@dataclass(frozen=True)
class Refusal:
    """Why there is no start yet."""

    reason: str


def pose_covariance(attitude: gtsam.Rot3, tilt: float) -> FloatArray:
    """Of a first pose, (6, 6): position and yaw are the world's choice, the tilt (rad) is not."""
    up = attitude.matrix().T @ np.array([0.0, 0.0, 1.0])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = tilt**2 * (np.eye(3) - np.outer(up, up)) + _GAUGE**2 * np.outer(up, up)
    covariance[3:, 3:] = _GAUGE**2 * np.eye(3)
    return covariance
