# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in space and the rays of a camera."""

import numpy as np

from ruledgraph.core.arrays import FloatArray

THROUGH_CENTRE = 1e-9
"""The image of a line whose moment in camera coordinates is shorter, of a unit direction, passes
through everything: the line goes through the camera's centre."""

# A ray is parallel to a line below this, the sine of their angle squared.
_PARALLEL = 1e-4


def closest_to_rays(
    foot: FloatArray, unit: FloatArray, centre: FloatArray, rays: FloatArray
) -> FloatArray:
    """Where lines, foot + s unit, are closest to rays: s (..., M), m; NaN where they are parallel.

    With the ray's direction d and the camera's centre c, cos = d . unit,

        s = ((c - foot) . unit - cos (c - foot) . d) / (1 - cos^2).

    Args:
        foot: a point of each line, (..., 3), m.
        unit: its direction, (..., 3).
        centre: of the camera, (..., 3), m.
        rays: directions of M rays to each line, (..., M, 3), of any length.
    """
    directions = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    cosine = np.einsum("...mi,...i->...m", directions, unit)
    offset = centre - foot
    sine2 = 1.0 - cosine * cosine
    along = np.einsum("...i,...i->...", offset, unit)[..., None]
    along = along - cosine * np.einsum("...mi,...i->...m", directions, offset)
    return np.asarray(along / np.where(sine2 < _PARALLEL, np.nan, sine2))
