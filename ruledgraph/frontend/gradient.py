# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The image gradient, sampled between pixels."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.frontend import kernel

BORDER_PX = 3.0
"""Pixels so near the border see the border's padding instead of the scene."""
# Deviation of the blur before differentiation, px: takes out pixel noise, keeps edges apart that
# are four pixels or more from one another. Its width: the native kernel is written out for it.
_BLUR, _WIDTH = 1.0, 9
# Scharr's derivative is 32 times the grey levels per pixel.
_SCALE = 1.0 / 32.0


def gradient_by_opencv(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Scharr's derivatives of the image (height, width) after a Gaussian blur, by x and y,
    (height, width, 2), grey levels per pixel; the reference of `_native_frame.gradient`.
    """
    blurred = cv2.GaussianBlur(image.astype(np.float32), (_WIDTH, _WIDTH), _BLUR)
    x = cv2.Scharr(blurred, cv2.CV_32F, 1, 0, scale=_SCALE)
    y = cv2.Scharr(blurred, cv2.CV_32F, 0, 1, scale=_SCALE)
    return np.asarray(cv2.merge([x, y]), np.float32)


def _gradient(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    if not kernel.is_native():
        return gradient_by_opencv(image)
    xy = np.empty((*image.shape, 2), np.float32)
    kernel.native.gradient(image, xy, _BLUR)
    return xy


class Gradient:
    """Gradient of a lightly blurred image, in grey levels per pixel."""

    def __init__(self, image: NDArray[np.uint8]) -> None:
        self.image = image
        self.height, self.width = image.shape
        # Side by side in memory: one look-up fetches both.
        self.xy = _gradient(image)
        """(height, width, 2)."""

    def inside(self, pixels: FloatArray) -> NDArray[np.bool_]:
        """Which pixels (..., 2) can be sampled."""
        limit = np.array([self.width, self.height]) - 1.0 - BORDER_PX
        return np.asarray(np.all((pixels >= BORDER_PX) & (pixels <= limit), axis=-1))

    def along(self, pixels: FloatArray, directions: FloatArray) -> NDArray[np.float32]:
        """Derivative at `pixels` (..., 2) along unit `directions` (..., 2), by bilinear
        interpolation; outside the image 0.
        """
        usable = self.inside(pixels)
        at = np.where(usable[..., None], pixels, BORDER_PX)
        whole = at.astype(np.int64)
        share = (at - whole).astype(np.float32)
        xy, index = self.xy.reshape(-1, 2), whole[..., 1] * self.width + whole[..., 0]
        u, v = share[..., :1], share[..., 1:]
        top = xy[index] * (1.0 - u) + xy[index + 1] * u
        below = index + self.width
        bottom = xy[below] * (1.0 - u) + xy[below + 1] * u
        gradient = top * (1.0 - v) + bottom * v
        slope = np.sum(gradient * directions.astype(np.float32), axis=-1)
        return np.asarray(np.where(usable, slope, np.float32(0.0)))
