# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Which part of the image plane lines are followed in."""

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray

# Normalised coordinates further out, 80 degrees from the optical axis, are not used: there a pixel
# of a fisheye spans 33 times as much of them outwards as in the middle of the image.
_WIDEST = 5.67


def field_of_view(camera: CameraModel) -> tuple[FloatArray, FloatArray]:
    """Least and largest normalised coordinates of the image's rim, (2,) each, but no more than
    those of 80 degrees from the optical axis, where a fisheye sees more than half a sphere, too.
    """
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    rim = np.concatenate([corners, [[0.5, 0.0], [0.5, 1.0], [0.0, 0.5], [1.0, 0.5]]])
    seen = camera.undistort(rim * [camera.width - 1, camera.height - 1])
    # A rim that is not in front of the camera has no coordinates.
    low = np.nan_to_num(seen.min(axis=0), nan=-np.inf)
    high = np.nan_to_num(seen.max(axis=0), nan=np.inf)
    return np.maximum(low, -_WIDEST), np.minimum(high, _WIDEST)


def within_reach(points: FloatArray) -> NDArray[np.bool_]:
    """Which normalised points (..., 2) are seen, and no further from the optical axis."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(points).max(axis=-1) < _WIDEST)
