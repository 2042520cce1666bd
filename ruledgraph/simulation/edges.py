# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Edge points of straight segments as an ideal detector would see them: no image in between."""

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray


def observe_segment(
    world_T_cam: gtsam.Pose3,
    ends: FloatArray,
    count: int,
    deviation: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Points on the image of a 3D segment, with isotropic noise.

    Args:
        world_T_cam: camera pose, optical axes.
        ends: of the segment in the world, (2, 3), m; both must lie in front of the camera.
        count: number of points, spread evenly at random along the image of the segment.
        deviation: of the noise in each coordinate, normalised image units.
        rng: source of all randomness.

    Returns:
        Normalised image coordinates, (count, 2).
    """
    in_cam = np.array([world_T_cam.transformTo(end) for end in ends])
    if np.any(in_cam[:, 2] <= 0.0):
        raise ValueError("ends: the segment reaches behind the camera")
    image = in_cam[:, :2] / in_cam[:, 2:]
    along = rng.uniform(size=(count, 1))
    return np.asarray(image[0] + along * (image[1] - image[0])) + rng.normal(
        scale=deviation, size=(count, 2)
    )
