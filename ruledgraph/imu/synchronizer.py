# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements as they come: on one clock, in order, frames until the IMU has reached them.

Faults of the sensors that a stream shows are noticed here: silences, hanging, spikes.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.sensors import Calibration, CameraModel
from ruledgraph.core.config import DEFAULTS, ImuConfig
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import MAX_IMU_GAP, Frame, Gap, ImuSample
from ruledgraph.core.timing import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.faults import Reading, SpikeFilter
from ruledgraph.imu.frame_history import FrameHistory, FrameTime


class Synchronizer:
    """The latest IMU samples, and the frames that wait for more of them."""

    def __init__(
        self, calibration: Calibration, warnings: Messages, config: ImuConfig = DEFAULTS.imu
    ) -> None:
        self.imu = ImuBuffer(config)
        self.frames = FrameHistory()
        """The frames that were processed."""
        self.correction = 0.0
        """Of the calibration's time offset, for the frames to come, s."""
        self._spikes = SpikeFilter(config)
        self._config = config
        self._calibration = calibration
        self._warnings = warnings
        self._origin: int | None = None
        self._waiting: deque[Frame] = deque()
        self._image: Frame | None = None

    def seconds(self, stamp: int) -> float:
        """Time of a stamp of the IMU's clock: since the first one."""
        if self._origin is None:
            self._origin = stamp
        return (stamp - self._origin) * 1e-9

    def frame_time(self, frame: Frame) -> float:
        """Of the IMU's clock, s."""
        return self.seconds(frame.stamp) + self._calibration.time_offset + self.correction

    def add_imu(self, sample: ImuSample) -> Gap | None:
        """Take in a sample.

        Returns:
            The gap before it, if the IMU was silent for too long: `begin_anew`, and add it again.
        """
        value = np.concatenate([sample.gyroscope, sample.accelerometer])
        gap = None
        for reading in self._spikes.take(self.seconds(sample.stamp), value):
            gap = self._append(reading, sample.stamp)
        return gap

    def _append(self, reading: Reading, stamp: int) -> Gap | None:
        time, before = reading.time, self.imu.latest
        hung = self.imu.append(time, reading.value[:3], reading.value[3:])
        if reading.replaced:
            self._warnings.counted(
                "the IMU spikes",
                f"the IMU spikes at {time:.2f} s: single readings far from both their neighbours "
                "are replaced by what lies between them",
            )
        if self.imu.range_news:
            self._warnings.append(
                f"{self.imu.range_news}, as found at {time:.2f} s: what it reads there is flagged; "
                "set a larger range"
            )
        if hung > self._config.max_sample_interval:
            self._warnings.append(
                f"the IMU hung at {before:.2f} s: the same reading for {hung:.2f} s is not used"
            )
        if before > -np.inf and self.imu.latest - before > MAX_IMU_GAP * 1e-9:
            return Gap(stamp - round((time - before) * 1e9), stamp)
        return None

    def add_image(self, frame: Frame) -> None:
        """Take in a frame; one whose image repeats the one before shows nothing.

        Raises:
            RuledgraphError: for an image that is not grey, of 8 bit and of the calibration's size.
        """
        if fault := image_fault(frame, self._calibration.camera):
            raise RuledgraphError(fault)
        last, self._image = self._image, frame
        if last is not None and frame.stamp != last.stamp and _same(frame.image, last.image):
            self._warnings.once(
                "the camera hangs",
                f"the camera hangs at {self.frame_time(frame):.2f} s: images that repeat the one "
                "before are not used",
            )
            frame = Frame(frame.stamp, np.zeros_like(frame.image))
        self._waiting.append(frame)

    def next_frame(self) -> Frame | None:
        """The next frame that the IMU has reached; it waits no longer."""
        if self._waiting and self.imu.latest >= self.frame_time(self._waiting[0]):
            return self._waiting.popleft()
        return None

    def timed(self, frame: Frame) -> FrameTime | None:
        """A frame with its time; None for one that cannot be used: it comes before the first IMU
        sample or after a later frame.
        """
        seen = FrameTime(frame.stamp, self.frame_time(frame))
        if not self.imu.covers(seen.time, seen.time):
            return None
        if not self.frames:
            return seen
        # By stamps, too: the time of one and the same changes with the correction.
        last = self.frames.last
        if seen.stamp < last.stamp:
            self._warnings.once(
                "late",
                f"a frame at {seen.time:.2f} s came after a later one: such are not used",
            )
        return seen if seen.stamp > last.stamp and seen.time > last.time else None

    def retime(self, change: float) -> None:
        """Move all frames in time, s."""
        self.correction += change
        self.frames.retime(change, self.imu)

    def begin_anew(self, stop: int) -> None:
        """Forget all before a stamp."""
        self.imu.clear()
        self._spikes = SpikeFilter(self._config)
        time = self.seconds(stop)
        self._waiting = deque(frame for frame in self._waiting if self.frame_time(frame) >= time)


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
    """Whether two images are equal; one row tells most apart."""
    row = len(image) // 2
    return np.array_equal(image[row], other[row]) and np.array_equal(image, other)
