# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""From the IMU's samples as they come to those that are used."""

import numpy as np

from ruledgraph.core.config import ImuConfig
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import MAX_IMU_GAP, Gap, ImuSample
from ruledgraph.core.messages import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.faults import Reading, SpikeFilter

# Without samples, s.
_LONGEST = MAX_IMU_GAP * 1e-9


class ImuInput:
    """Leaves out or replaces what is no reading, says so, and keeps the rest."""

    def __init__(self, warnings: Messages, config: ImuConfig) -> None:
        self.buffer = ImuBuffer(config)
        self._warnings = warnings
        self._config = config
        self._spikes = SpikeFilter(config)
        self._latest_sample = -np.inf
        self._is_ahead = False  # the sample before was far ahead of the others

    def add(self, time: float, sample: ImuSample) -> Gap | None:
        """Take in a sample of a time, s; one with NaN or infinity is left out.

        Returns:
            The gap before it, if the IMU was silent for too long: `clear`, and add it again.

        Raises:
            RuledgraphError: for another shape.
        """
        shapes = np.shape(sample.gyroscope), np.shape(sample.accelerometer)
        if shapes != ((3,), (3,)):
            raise RuledgraphError(
                "an IMU sample has 3 numbers of the gyroscope and 3 of the accelerometer, not "
                f"shapes {shapes[0]} and {shapes[1]}"
            )
        value = np.concatenate(sample[1:])
        if not np.isfinite(value).all():
            self._warnings.counted(
                "not finite",
                f"the IMU sample at {time:.2f} s is not finite: such samples are left out",
            )
            return None
        if time <= self._latest_sample:
            self._warnings.counted(
                "late IMU samples",
                f"an IMU sample at {time:.2f} s came after one at {self._latest_sample:.2f} s: "
                "out of order, dropped",
            )
            return None
        if self._may_be_wrong(time):
            return None
        self._latest_sample = time
        for reading in self._spikes.take(time, value):
            # One that might have been a spike was held back until now.
            stamp = sample.stamp - round((time - reading.time) * 1e9)
            if gap := self._append(reading, stamp):
                return gap
        return None

    def _may_be_wrong(self, time: float) -> bool:
        """Whether a stamp, s, is so far ahead of the last one that it may be wrong: the next one
        shows it, which is as far ahead where the IMU was silent.
        """
        was_ahead, is_ahead = self._is_ahead, -np.inf < self._latest_sample < time - _LONGEST
        self._is_ahead = is_ahead and not was_ahead
        if was_ahead and not is_ahead:
            self._warnings.counted(
                "IMU samples ahead",
                f"an IMU sample before {time:.2f} s was stamped far ahead of it: dropped",
            )
        return self._is_ahead

    def _append(self, reading: Reading, stamp: int) -> Gap | None:
        time, before = reading.time, self.buffer.latest
        frozen = self.buffer.append(time, reading.value[:3], reading.value[3:])
        if reading.replaced:
            self._warnings.counted(
                "the IMU spikes",
                f"the IMU spikes at {time:.2f} s: single readings far from both their neighbours "
                "are replaced by what lies between them",
            )
        if self.buffer.range_message:
            self._warnings.append(
                f"{self.buffer.range_message}, as found at {time:.2f} s: what it reads there is "
                "flagged; set a larger range"
            )
        if frozen > self._config.max_sample_interval:
            self._warnings.append(
                f"the IMU was frozen at {before:.2f} s: the same reading for {frozen:.2f} s is not "
                "used"
            )
        if before > -np.inf and self.buffer.latest - before > _LONGEST:
            return Gap(stamp - round((time - before) * 1e9), stamp)
        return None

    def clear(self) -> None:
        """Forget all samples."""
        self.buffer.clear()
        self._spikes = SpikeFilter(self._config)
        self._latest_sample, self._is_ahead = -np.inf, False
