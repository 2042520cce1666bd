# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A run as a video of overlays, which plays as fast as it was recorded."""

import os
from pathlib import Path

import cv2

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.context import Closing
from ruledgraph.core.errors import MachineError, RuledgraphError
from ruledgraph.core.measurements import Frame
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.overlay import draw_overlay, overlay_size
from ruledgraph.visualization.views import View, ViewQueue

RATE = 30
"""Images a second."""
# A larger overlay is scaled down, px; the writer's files are large.
_WIDEST = 960
# An image is held through a gap for this long at most, s.
_LONGEST_HOLD = 2.0
# Of times in images.
_ROUNDING = 1e-3


class VideoError(RuledgraphError):
    """A video that cannot be written."""


class Video(Closing):
    """Writes an MP4 file (MPEG-4) by OpenCV's writer.

    Args:
        path: must not exist.
        camera: of the frames that will be shown.

    Raises:
        VideoError: when the file exists, is no .mp4, or cannot be written.
    """

    def __init__(self, path: Path, camera: CameraModel) -> None:
        if path.suffix != ".mp4":
            raise VideoError(f"{path}: a video is an .mp4 file; give it that suffix")
        if path.exists():
            raise VideoError(f"{path}: exists already, choose another name")
        width, height = overlay_size(camera)
        shrink = min(1.0, _WIDEST / width)
        # Both even, as the format wants them.
        self._size = 2 * round(0.5 * shrink * width), 2 * round(0.5 * shrink * height)
        code = cv2.VideoWriter.fourcc(*"mp4v")
        self._writer = cv2.VideoWriter(str(path), code, RATE, self._size)
        if not self._writer.isOpened():
            raise VideoError(f"{path}: cannot be written")
        self._path = path
        self._camera = camera
        self._views = ViewQueue()
        self._due: float | None = None
        """Time of the next image, s since the first frame."""

    def watch(self, odometry: Odometry, frame: Frame) -> None:
        """Draw the frames that have been processed when a frame has been added."""
        for view in self._views.take(odometry, frame):
            self.show(view)

    def show(self, view: View) -> None:
        """Add a frame; of a fast camera frames are left out, of a slow one they are repeated."""
        due = view.since_start if self._due is None else self._due
        ready = int((view.since_start - due) * RATE + 1.0 + _ROUNDING)
        copies = min(ready, round(_LONGEST_HOLD * RATE))
        if copies > 0:
            overlay = draw_overlay(view, self._camera)
            image = cv2.resize(overlay, self._size, interpolation=cv2.INTER_AREA)
            for _ in range(copies):
                self._writer.write(image)
            self._due = max(due + copies / RATE, view.since_start)

    def close(self) -> None:
        """Finish the file; one without an image is removed.

        Raises:
            MachineError: for one that is not whole, as without space: it cannot be played.
        """
        self._writer.release()
        if self._due is None:
            self._path.unlink(missing_ok=True)
        elif not self._is_whole():
            self._path.unlink(missing_ok=True)
            raise MachineError(f"{self._path}: cannot be written; is there space left?")

    def _is_whole(self) -> bool:
        """Whether it has its index: OpenCV's writer does not say when the disk is full."""
        with self._path.open("rb") as file:
            while header := file.read(8):
                size, kind = int.from_bytes(header[:4], "big"), header[4:]
                if kind == b"moov" or size < len(header):
                    break
                file.seek(size - len(header), os.SEEK_CUR)
            else:
                return False
            return kind == b"moov"
