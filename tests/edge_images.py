# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images of straight edges whose place is known exactly."""

import numpy as np
from scipy.special import expit

from ruledgraph.calibration.camera_model import CameraModel

CAMERA = CameraModel(320, 240, 300.0, 300.0, 160.0, 120.0)


def normalised_grid(camera: CameraModel) -> np.ndarray:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    return camera.undistort(pixels).reshape(camera.height, camera.width, 2)


def edge_image(
    camera: CameraModel,
    lines: list[tuple[np.ndarray, float]],
    rng: np.random.Generator | None = None,
    dark: float = 60.0,
    blur: float = 0.9,
) -> np.ndarray:
    """Grey `dark`, plus `step` on the side of each ruling (a, b, c) where a x + b y + c > 0; edges
    are `blur` px wide, the noise 1.5 grey levels.
    """
    grid = normalised_grid(camera)
    image = np.full((camera.height, camera.width), dark)
    for line, step in lines:
        a, b, c = line / np.hypot(line[0], line[1])
        distance = (grid[..., 0] * a + grid[..., 1] * b + c) * camera.focal_length
        image += step * expit(1.7 * distance / blur)
    if rng is not None:
        image += rng.normal(scale=1.5, size=image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def line_through(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(a, b, c) of the ruling through two normalised points, positive towards `normal_of`."""
    along = second - first
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return np.append(normal, -normal @ first)
