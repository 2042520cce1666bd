# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images as they come: what is wrong with one, and whether the camera is frozen."""

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame
from ruledgraph.core.stamps import CLOSEST_FRAMES, StampUnit

# The next image cannot begin before the last row is read. As stamps scatter: so many in a row, and
# by a share of the readout.
_MANY_CLOSE, _CLOSE = 10, 0.9


class ImageInput:
    """Checks each frame against the calibration and the frame before it."""

    def __init__(self, camera: CameraModel, readout: float = 0.0) -> None:
        self.newest: Frame | None = None
        """The last frame that was checked."""
        self._camera = camera
        self._unit = StampUnit("images", CLOSEST_FRAMES)
        self._readout = readout
        self._too_close = 0

    def checked(self, frame: Frame) -> tuple[bool, Frame]:
        """Whether the camera is frozen, and the frame as it may be used: of a frozen camera's,
        which repeats the image before, nothing is shown.

        Raises:
            RuledgraphError: for an image that is not grey, of 8 bit and of the calibration's size,
                for stamps in another unit, and when images come faster than their rows are read.
        """
        if fault := image_fault(frame, self._camera):
            raise RuledgraphError(fault)
        self._unit.check(frame.stamp)
        last, self.newest = self.newest, frame
        if last is not None and self._readout:
            self._check_interval(1e-9 * (frame.stamp - last.stamp))
        if last is None or frame.stamp == last.stamp or not _same(frame.image, last.image):
            return False, frame
        return True, Frame(frame.stamp, np.zeros_like(frame.image))

    def _check_interval(self, apart: float) -> None:
        close = 0.0 < apart < _CLOSE * self._readout
        self._too_close = self._too_close + 1 if close else 0
        if self._too_close >= _MANY_CLOSE:
            raise RuledgraphError(
                f"images come {1e3 * apart:.1f} ms apart, but the rows of one are read within "
                f"{1e3 * self._readout:.1f} ms: check line_delay (s per row) or --readout (s)"
            )


def image_fault(frame: Frame, camera: CameraModel) -> str:
    """What is wrong with a frame's image, empty if nothing is."""
    image = frame.image
    if image.dtype != np.uint8:
        return f"a frame's image is {image.dtype}; convert images to 8 bit, uint8"
    if image.ndim != 2:
        return f"a frame's image has shape {image.shape}; convert images to grey, (height, width)"
    height, width = image.shape
    if (width, height) != (camera.width, camera.height):
        return (
            f"a frame is {width}x{height}, but the calibration is for {camera.width}x"
            f"{camera.height}; use the calibration of this camera and resolution"
        )
    return ""


def _same(image: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Whether two images are equal; one row distinguishes most."""
    row = len(image) // 2
    return np.array_equal(image[row], other[row]) and np.array_equal(image, other)
