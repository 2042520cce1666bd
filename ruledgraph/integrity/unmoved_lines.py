# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether lines that have not moved in the image contradict a motion by the IMU."""

import numpy as np
from scipy.special import logsumexp

from ruledgraph.core.arrays import FloatArray

# Logarithms of distances, in standard deviations from the usual one, and their weights.
_STEPS = np.linspace(-5.0, 5.0, 41)
_LOG_WEIGHTS = -0.5 * _STEPS**2 - logsumexp(-0.5 * _STEPS**2)
_NOISE = 0.1
"""px; how well lines of real images are found, see ACCURACY.md; rendered ones are found better."""


def log_odds_of_rest(
    lines: FloatArray,
    moved: FloatArray,
    translation: FloatArray,
    distance: float,
    factor: float,
) -> float:
    """Log of how much likelier the motions of lines are if the camera rests than if it has moved.

    A translation t moves a line l, |l_xy| = 1, at a distance Z by about |l . t| / Z across itself.
    A line's motion m has Cauchy noise of scale s:

        p(m | rest) = prod_i C_s(m_i),    p(m | t) = E_Z prod_i C_s(m_i - |l_i . t| / Z),

    once with a distance for each line and once with one for all, as of a scene that is far away;
    both count for one half. Without lines it is 0.

    Args:
        lines: in the image, (N, 3), normalised coordinates.
        moved: how far each moved across itself, (N,), px.
        translation: of the camera in its frame times the focal length, (3,), m px.
        distance: that lines usually have, m.
        factor: by what that may be wrong, one standard deviation.
    """
    if not len(lines):
        return 0.0
    expected = np.abs(lines @ translation) / distance  # (N,), at the usual distance
    at = expected[:, None] / factor**_STEPS  # (N, K)
    rest = -np.log1p(np.square(moved / _NOISE))
    motion = -np.log1p(np.square((moved[:, None] - at) / _NOISE))
    own = float(np.sum(logsumexp(motion + _LOG_WEIGHTS, axis=1)))
    common = float(logsumexp(motion.sum(axis=0) + _LOG_WEIGHTS))
    return float(rest.sum() - np.logaddexp(own, common) + np.log(2.0))
