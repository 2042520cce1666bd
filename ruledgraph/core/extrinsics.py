# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's pose in the body, with its covariance."""

from typing import NamedTuple

import gtsam

from ruledgraph.core.arrays import FloatArray


class Extrinsics(NamedTuple):
    """How the camera is mounted on the body."""

    body_T_cam: gtsam.Pose3
    covariance: FloatArray
    """Of its tangent (GTSAM's: right perturbation, rotation first), (6, 6), rad and m."""
