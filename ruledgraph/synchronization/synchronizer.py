# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements as they come: on one clock, in order, frames until the IMU has reached them.

Faults of the sensors that a stream shows are noticed here: silences, frozen sensors, spikes.
"""

from collections.abc import Callable

import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import DEFAULTS, ImuConfig
from ruledgraph.core.measurements import MAX_IMU_GAP, Frame, Gap, ImuSample
from ruledgraph.core.messages import Messages
from ruledgraph.core.stamps import CLOSEST_SAMPLES, StampUnit
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.imu_input import ImuInput
from ruledgraph.synchronization.frame_history import FrameHistory, FrameTime
from ruledgraph.synchronization.image_input import ImageInput
from ruledgraph.synchronization.waiting_frames import WaitingFrames

# s; stamps of two sensors so far apart are of clocks without a common base, or in two units.
_UNRELATED = 10.0


class Synchronizer:
    """The latest IMU samples, and the frames that wait for more of them."""

    def __init__(
        self, calibration: Calibration, warnings: Messages, config: ImuConfig = DEFAULTS.imu
    ) -> None:
        self._imu_input = ImuInput(warnings, config)
        self.frames = FrameHistory()
        """The frames that were processed."""
        self.offset_correction = 0.0
        """What is added to the calibration's time offset for the frames to come, s."""
        self.image_rests: Callable[[], bool] = lambda: False
        """Whether the image shows no motion: then an IMU that repeats its reading is not frozen."""
        self._config = config
        self.calibration = calibration
        """Of the frames to come: their rows may be known later."""
        self._warnings = warnings
        self._origin: int | None = None
        self._imu_unit = StampUnit("IMU samples", CLOSEST_SAMPLES, MAX_IMU_GAP)
        self._image_input = ImageInput(calibration.camera, calibration.readout)
        # By a known offset between the clocks frames wait longer.
        longest = config.max_frame_wait + max(calibration.time_offset, 0.0)
        self._waiting = WaitingFrames(round(longest * 1e9))
        self._silence_reported = False

    @property
    def imu(self) -> ImuBuffer:
        """The latest samples."""
        return self._imu_input.buffer

    def seconds(self, stamp: int) -> float:
        """Time of a stamp of the IMU's clock: since the first one."""
        if self._origin is None:
            self._origin = stamp
        return (stamp - self._origin) * 1e-9

    def frame_time(self, frame: Frame) -> float:
        """Of the IMU's clock, s; of a rolling shutter that of the middle row."""
        of_stamp = self.calibration.time_offset + self.offset_correction
        return self.seconds(frame.stamp) + of_stamp + self.calibration.middle_row_delay

    def add_imu(self, sample: ImuSample) -> Gap | None:
        """Take in a sample.

        Returns:
            The gap before it, if the IMU was silent for too long: `restart`, and `add_after_gap`.

        Raises:
            RuledgraphError: for another shape, and for stamps in another unit.
        """
        self._imu_unit.check(sample.stamp)
        return self._imu_input.add(self.seconds(sample.stamp), sample)

    def add_after_gap(self, sample: ImuSample) -> None:
        """Take in the sample before which `add_imu` has found a gap."""
        self._imu_input.add(self.seconds(sample.stamp), sample)

    def add_image(self, frame: Frame) -> None:
        """Take in a frame; one whose image repeats the one before shows nothing.

        Raises:
            RuledgraphError: for an image that is not grey, of 8 bit and of the calibration's size,
                and for stamps in another unit.
        """
        frozen, frame = self._image_input.checked(frame)
        if frozen:
            self._warnings.once(
                "the camera is frozen",
                f"the camera is frozen at {self.frame_time(frame):.2f} s: images that repeat the "
                "one before are not used",
            )
        self._put(frame)
        if self._ahead() > self._config.silent_time and not self._silence_reported:
            self._silence_reported = True
            self._warnings.append(_silence(self.imu, self._ahead(), self._config))

    def _put(self, frame: Frame) -> None:
        time = self.frame_time(frame)
        dropped = self._waiting.add(frame)
        if dropped is None:
            self._warnings.once(*_late(time))
        for _ in range(dropped or 0):
            self._warnings.counted(
                "images are dropped",
                f"images are dropped at {time:.2f} s: no IMU samples reach them",
            )

    def next_frame(self) -> Frame | None:
        """The next frame that the IMU has reached; it waits no longer."""
        frame = self._waiting.first
        if frame is None:
            return None
        time = self.frame_time(frame) + 0.5 * self.calibration.readout
        if self.imu.latest < time and self.imu.frozen_for > 0.0 and self.image_rests():
            self.imu.accept_repeats()
        if self.imu.latest < time:
            return None
        self._silence_reported = False
        return self._waiting.take()

    # -- silence ---------------------------------------------------------------------------------

    @property
    def waits_for(self) -> str:
        """The sensor that is silent, by the other one's stamps: `IMU`, `images`, or empty."""
        latest, newest = self.imu.latest, self._image_input.newest
        if latest == -np.inf or self._ahead() > self._config.silent_time:
            return "IMU"
        behind = self._config.silent_time + max(-self.calibration.time_offset, 0.0)
        return "images" if newest is None or latest - self.frame_time(newest) > behind else ""

    def _first_waiting(self) -> float:
        first = self._waiting.first
        return -np.inf if first is None else self.frame_time(first)

    def _ahead(self) -> float:
        """How far the newest of the frames that wait is beyond the latest IMU sample, but for the
        known offset, s.
        """
        last = self._waiting.last
        if last is None:
            return 0.0
        since = self._first_waiting() if self.imu.latest == -np.inf else self.imu.latest
        return self.frame_time(last) - since - max(self.calibration.time_offset, 0.0)

    # -- a frame's time --------------------------------------------------------------------------

    def timed(self, frame: Frame) -> FrameTime | None:
        """A frame with its time; None for one that cannot be used: it comes before the first IMU
        sample or after a later frame.
        """
        seen = FrameTime(frame.stamp, self.frame_time(frame))
        half = 0.5 * self.calibration.readout
        if not self.imu.covers(seen.time - half, seen.time + half):
            if self.imu.earliest - seen.time > _UNRELATED:
                self._warnings.once(
                    "images are behind the IMU",
                    f"images are {self.imu.latest - seen.time:.1f} s behind the IMU: check that "
                    "their clocks and units are the same",
                )
            return None
        if not self.frames:
            return seen
        # By stamps, too: the time of one and the same changes with the correction.
        last = self.frames.last
        if seen.stamp < last.stamp:
            self._warnings.once(*_late(seen.time))
        return seen if seen.stamp > last.stamp and seen.time > last.time else None

    def retime(self, change: float) -> None:
        """Move all frames in time, s."""
        self.offset_correction += change
        self.frames.retime(change, self.imu)

    def restart(self, stop: int) -> None:
        """Forget all before a stamp."""
        self._imu_input.clear()
        while self._first_waiting() < self.seconds(stop) and self._waiting:
            self._waiting.take()


def _silence(imu: ImuBuffer, ahead: float, config: ImuConfig) -> str:
    """What there is to say when images are so far ahead (s) of the IMU."""
    if imu.latest == -np.inf:
        return f"no IMU samples came in {ahead:.1f} s: images wait for them"
    if imu.frozen_for > config.max_sample_interval:
        return (
            f"the IMU has been frozen since {imu.latest:.2f} s: it repeats one reading, which is "
            "not used"
        )
    if ahead > _UNRELATED:
        return (
            f"images are {ahead:.1f} s ahead of the IMU: check that their clocks and units are "
            "the same"
        )
    return f"no IMU samples since {imu.latest:.2f} s: images wait for them"


def _late(time: float) -> tuple[str, str]:
    """Kind and text of a warning."""
    return "late", f"a frame at {time:.2f} s came after a later one: out of order, dropped"
