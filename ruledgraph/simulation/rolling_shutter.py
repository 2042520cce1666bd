# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A rolling shutter's image from renderings at some moments.

Row r is exposed for e seconds around t + r line_delay. Between neighbouring moments, close enough
that nothing moves by more than a pixel, brightness is interpolated linearly in time: where an edge
moved by d pixels, the mean of its two images with weights 1 - w and w has it at w d. A row is then
the mean over its exposure, a weighted sum of the same row at the moments.
"""

import numpy as np

from ruledgraph.core.arrays import FloatArray


def row_weights(row_times: FloatArray, moments: FloatArray, exposure: float) -> FloatArray:
    """Share of each rendering in each row, (H, J); rows sum to 1.

    Args:
        row_times: middle of the exposure of the rows, (H,), s.
        moments: of the renderings, (J,), evenly spaced from the begin of the first exposure to the
            end of the last, s; J >= 2.
        exposure: of a row, s.
    """
    step = moments[1] - moments[0]
    from_moment = (row_times[:, None] - moments) / step
    if exposure <= 0.0:
        return np.asarray(np.maximum(1.0 - np.abs(from_moment), 0.0))
    half = 0.5 * exposure / step
    weights = _integrated_hat(from_moment + half) - _integrated_hat(from_moment - half)
    return np.asarray(weights / (2.0 * half))


def _integrated_hat(x: FloatArray) -> FloatArray:
    """Of max(1 - |x|, 0), from minus infinity."""
    u = np.clip(x, -1.0, 1.0)
    return np.asarray(np.where(u < 0.0, 0.5 * (1.0 + u) ** 2, 1.0 - 0.5 * (1.0 - u) ** 2))


def rows_with_weight(weights: FloatArray) -> slice:
    """From the first to the last row that a rendering has a share in, of its weights (H,)."""
    rows = np.flatnonzero(weights)
    return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(0, 0)
