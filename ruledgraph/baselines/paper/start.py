# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The points of a frame, and the first lines among them."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.frontend.sobel import sobel_points

# Section VII-B: a found line's points are removed this far from it, normalised ("5 centimeters").
_REMOVE = 0.05
# A found segment's points lie this close to it, normalised: the transform's rho of 5 px.
_NEAR = 0.013


class PointDetector:
    """Thresholded Sobel points as normalised coordinates."""

    def __init__(self, camera: CameraModel) -> None:
        v, u = np.mgrid[: camera.height, : camera.width]
        pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
        self._normalised = camera.undistort(pixels).reshape(camera.height, camera.width, 2)
        # Sobel's kernel sees the padding at the border.
        inside = np.pad(np.ones((camera.height - 2, camera.width - 2), dtype=bool), 1)
        self._valid = inside & np.isfinite(self._normalised).all(axis=2)

    def mask(self, image: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Where the image has points, (height, width)."""
        return np.asarray(sobel_points(image) & self._valid)

    def points(self, image: NDArray[np.uint8]) -> FloatArray:
        """All points of an image, (N, 2)."""
        return np.asarray(self._normalised[self.mask(image)])

    def lines(self, image: NDArray[np.uint8], most: int) -> FloatArray:
        """The strongest lines of an image, at most so many: ends, normalised, (M, 2, 2).

        Hough transform with rho 5 px, theta 1 degree, threshold 100, minimum length 100 px,
        largest gap 5 px; the strongest line's points are removed and the transform repeated.
        """
        mask = self.mask(image)
        found: list[FloatArray] = []
        while len(found) < most:
            segments = cv2.HoughLinesP(
                mask.astype(np.uint8) * 255, 5, np.pi / 180, 100, minLineLength=100, maxLineGap=5
            )
            if segments is None:
                break
            ends = np.asarray(segments).reshape(-1, 2, 2)
            longest = ends[int(np.argmax(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))]
            line = self._fitted(mask, self._normalised[longest[:, 1], longest[:, 0]])
            found.append(line)
            mask &= np.abs(_across(self._normalised, line)) > _REMOVE
        return np.array(found).reshape(-1, 2, 2)

    def _fitted(self, mask: NDArray[np.bool_], ends: FloatArray) -> FloatArray:
        """Total least squares through the points along a segment."""
        points = self._normalised[mask]
        direction = ends[1] - ends[0]
        along = (points - ends[0]) @ direction / (direction @ direction)
        near = (np.abs(_across(points, ends)) < _NEAR) & (along > 0.0) & (along < 1.0)
        centre = points[near].mean(axis=0)
        axis = np.linalg.svd(points[near] - centre, full_matrices=False)[2][0]
        return np.asarray(centre + np.outer((ends - centre) @ axis, axis))


def _across(points: FloatArray, ends: FloatArray) -> FloatArray:
    """Signed distance of points (..., 2) from the line through two ends (2, 2)."""
    direction = ends[1] - ends[0]
    normal = np.array([-direction[1], direction[0]]) / np.linalg.norm(direction)
    return np.asarray((points - ends[0]) @ normal)
