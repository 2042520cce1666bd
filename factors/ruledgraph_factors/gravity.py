# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude by gravity."""

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.validation import finite_array

# Cosine of the angle to the vertical beyond which the x axis is too upright to be made level.
_UPRIGHT = 0.9


def level_attitude(up: ArrayLike) -> gtsam.Rot3:
    """world_R_body that turns `up` (3,), of any length, in the body frame to the world's z axis.

    The heading is free: the body's x axis (y, where x is upright) is made level and becomes the
    world's x axis. At rest the accelerometer shows `up`; else it is minus gravity.

    Raises:
        FactorError: for a zero vector.
    """
    z = finite_array("up", up, (3,))
    size = float(np.linalg.norm(z))
    if size == 0.0:
        raise FactorError("up is zero and shows no direction")
    z = z / size
    axis = np.eye(3)[0] if abs(z[0]) < _UPRIGHT else np.eye(3)[1]
    x = axis - z * (z @ axis)
    x = x / np.linalg.norm(x)
    return gtsam.Rot3(np.stack([x, np.cross(z, x), z]))
