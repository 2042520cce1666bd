# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The ray of every pixel of a camera, and what is sampled along it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation.scene import Texture

Image = NDArray[np.float32]

# The largest normalised radius that is drawn: 80 degrees from the optical axis.
_IMAGE_CIRCLE = np.tan(np.radians(80.0))


class PinholeRays:
    """Rays of a camera without distortion."""

    seen: NDArray[np.bool_] | None = None
    """Which pixels are inside of the image circle, if not all are."""

    def __init__(self, camera: CameraModel) -> None:
        self._pixel_to_ray = np.array(
            [
                [1.0 / camera.fx, 0.0, -camera.cx / camera.fx],
                [0.0, 1.0 / camera.fy, -camera.cy / camera.fy],
                [0.0, 0.0, 1.0],
            ]
        )
        self.scale = float(np.sqrt(camera.fx * camera.fy))
        corners = np.array([[0, 0, 1], [camera.width - 1, camera.height - 1, 1]])
        self.field = (corners @ self._pixel_to_ray.T)[:, :2]
        self._columns, self._rows = np.arange(camera.width), np.arange(camera.height)

    def scale_at(self, _rows: slice, _columns: slice) -> float:
        """Pixels in a normalised unit, in the middle of a part of the image."""
        return self.scale

    def sample(self, texture: Texture, H: FloatArray, rows: slice, columns: slice) -> Texture:
        """A texture at every pixel, where H maps rays to texture pixels."""
        M = H @ self._pixel_to_ray
        M[:, 2] += M[:, :2] @ [columns.start, rows.start]
        size = columns.stop - columns.start, rows.stop - rows.start
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        sampled = cv2.warpPerspective(
            texture, M, size, flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(sampled)

    def distance(self, plane: FloatArray, rows: slice, columns: slice) -> Image:
        """Distance from a line in the image, px, whose unit normal and offset are `plane` (3,)."""
        a, b, c = self.scale * plane @ self._pixel_to_ray
        across = (a * self._columns[columns]).astype(np.float32)
        along = (b * self._rows[rows] + c).astype(np.float32)
        return np.asarray(across[None, :] + along[:, None])


class BentRays:
    """Rays of a camera with distortion; outside of its image circle nothing is seen.

    Raises:
        RuledgraphError: when the distortion has no inverse somewhere, but for a fisheye.
    """

    def __init__(self, camera: CameraModel) -> None:
        shape = camera.height, camera.width
        pixels = np.stack(np.meshgrid(*(np.arange(size) for size in shape[::-1])), axis=-1)
        rays = camera.undistort(pixels.reshape(-1, 2))
        with np.errstate(invalid="ignore"):
            seen = np.hypot(rays[:, 0], rays[:, 1]) < _IMAGE_CIRCLE
        if camera.distortion == "radtan" and not np.isfinite(rays).all():
            raise RuledgraphError("the camera's distortion has no inverse in all of the image")
        rays = np.where(seen[:, None], rays, 0.0)
        self._rays = rays.reshape(*shape, 2).astype(np.float32)
        scale = np.sqrt(np.linalg.det(camera.distort(rays).jacobian))
        self._scale = scale.reshape(shape).astype(np.float32)
        self.scale = float(scale.min())
        self.field = np.stack([rays.min(axis=0), rays.max(axis=0)])
        self.seen: NDArray[np.bool_] | None = None if seen.all() else seen.reshape(shape)

    def scale_at(self, rows: slice, columns: slice) -> float:
        """As `PinholeRays.scale_at`."""
        row, column = (rows.start + rows.stop) // 2, (columns.start + columns.stop) // 2
        return float(self._scale[row, column])

    def sample(self, texture: Texture, H: FloatArray, rows: slice, columns: slice) -> Texture:
        """As `PinholeRays.sample`."""
        at = cv2.perspectiveTransform(self._rays[rows, columns], H)
        column, row = cv2.split(at)
        sampled = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(sampled)

    def distance(self, plane: FloatArray, rows: slice, columns: slice) -> Image:
        """As `PinholeRays.distance`."""
        distance = cv2.transform(self._rays[rows, columns], plane[None])
        return np.asarray(distance * self._scale[rows, columns])
