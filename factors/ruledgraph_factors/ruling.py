# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A new line from its edge points in one image."""

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.validation import FloatArray, image_points

NEW_LINE_SIGMAS = (1.0, 1.0, 10.0, 10.0)
"""Prior deviations of a new line's delta: anywhere in front and in any direction, while the viewing
plane (delta[2], delta[3]) is left to the points. Without a prior a new line is indeterminate."""


def line_from_ruling(
    world_T_cam: gtsam.Pose3, points: ArrayLike, inverse_distance: float
) -> LineChart:
    """Chart of a new line from its edge points in one image and a guess of its distance.

    The image line is the total-least-squares fit; the line is taken perpendicular to the ray
    through the middle of the points, at 1 / inverse_distance from the camera's centre. Give the two
    unseen directions, delta[0] and delta[1], a wide prior in the graph: `NEW_LINE_SIGMAS`.

    Args:
        world_T_cam: camera pose (optical axes), the chart's anchor.
        points: normalised image coordinates, (N, 2), at least two distinct ones.
        inverse_distance: guess, >= 0, 1/m. A factor of two wrong is no trouble; a line that runs
            more than about 45 degrees towards or away from the camera can be, see EMBEDDING.md.

    Raises:
        FactorError: for points that do not define a line.
    """
    xy = image_points("points", points)
    line, middle = fit_image_line("points", xy)
    return LineChart.from_ruling(world_T_cam, line, inverse_distance, middle)


def fit_image_line(name: str, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Total-least-squares line (a, b, c), a^2 + b^2 = 1, and the middle of the points."""
    if len(xy) < 2:
        raise FactorError(f"{name} has {len(xy)} point(s), a line takes two")
    middle = xy.mean(axis=0)
    _, spread, axes = np.linalg.svd(xy - middle, full_matrices=False)
    if spread[0] <= 1e-12:
        raise FactorError(f"{name} all coincide, no line runs through them alone")
    normal = np.array([-axes[0, 1], axes[0, 0]])
    return np.append(normal, -normal @ middle), middle
