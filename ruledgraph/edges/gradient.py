# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The image gradient, sampled between pixels."""

import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.sensors import FloatArray

# Deviation of the blur before differentiation, px: takes out pixel noise, keeps edges apart that
# are four pixels or more from one another.
_BLUR = 1.0
# Scharr's derivative is 32 times the grey levels per pixel.
_SCALE = 1.0 / 32.0
# Pixels next to the border see the border's padding instead of the scene.
_BORDER = 3.0


class _Scratch(threading.local):
    """Four images of floats, used again by each thread: to ask the system for the memory of every
    frame anew takes longer than all that is computed in it.
    """

    def __init__(self) -> None:
        self._images = np.empty((4, 0, 0), np.float32)

    def of(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """(4, height, width); what is in them has no meaning."""
        if self._images.shape[1:] != shape:
            self._images = np.empty((4, *shape), np.float32)
        return self._images


_scratch = _Scratch()


class Gradient:
    """Gradient of a lightly blurred image, in grey levels per pixel."""

    def __init__(self, image: NDArray[np.uint8]) -> None:
        self.image = image
        self.height, self.width = image.shape
        grey, blurred, x, y = _scratch.of(image.shape)
        np.copyto(grey, image)
        cv2.GaussianBlur(grey, (9, 9), _BLUR, dst=blurred)
        cv2.Scharr(blurred, cv2.CV_32F, 1, 0, dst=x, scale=_SCALE)
        cv2.Scharr(blurred, cv2.CV_32F, 0, 1, dst=y, scale=_SCALE)
        # Side by side in memory: one look-up fetches both.
        self.xy = np.asarray(cv2.merge([x, y]), np.float32)
        """(height, width, 2)."""

    def inside(self, pixels: FloatArray) -> NDArray[np.bool_]:
        """Which pixels (..., 2) can be sampled."""
        limit = np.array([self.width, self.height]) - 1.0 - _BORDER
        return np.asarray(np.all((pixels >= _BORDER) & (pixels <= limit), axis=-1))

    def along(self, pixels: FloatArray, directions: FloatArray) -> NDArray[np.float32]:
        """Derivative at `pixels` (..., 2) along unit `directions` (..., 2), by bilinear
        interpolation; outside the image 0.
        """
        usable = self.inside(pixels)
        at = np.where(usable[..., None], pixels, _BORDER)
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
