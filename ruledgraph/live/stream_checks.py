# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is known of a sensor's stream as it is added: whether it is silent, and mistakes in units
and order that show only over several measurements.
"""

import time as clock

import numpy as np

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import MeasurementError, RuledgraphError
from ruledgraph.core.measurements import MAX_IMU_GAP, Frame, ImuSample
from ruledgraph.core.stamps import CLOSEST_FRAMES, CLOSEST_SAMPLES
from ruledgraph.core.trajectory import seconds
from ruledgraph.synchronization.image_input import image_fault

# So many samples in a row that are too far apart to be integrated are in another unit.
_SPARSE = 3
# Over so many samples, and for so long (ns), the specific force averages near gravity, 9.81 m/s^2:
# a body that falls freely all the while, or is thrown at 6 g, has no use for an odometry.
_AVERAGED, _AVERAGED_TIME = 100, 10**9
_MIN_FORCE, _MAX_FORCE = 2.0, 60.0
# A sensor that delivered nothing for so long is silent, s.
_SILENT = 1.0


class Stream:
    """One sensor's measurements."""

    def __init__(self) -> None:
        self.count = 0
        self._last: int | None = None
        self._arrived = -_SILENT

    @property
    def is_silent(self) -> bool:
        """Whether nothing came for a second, or at all."""
        return self.count == 0 or clock.monotonic() - self._arrived >= _SILENT

    def _note(self, stamp: int) -> None:
        self.count, self._last, self._arrived = self.count + 1, stamp, clock.monotonic()


class ImuStream(Stream):
    """IMU samples."""

    def __init__(self) -> None:
        super().__init__()
        self._sparse = 0
        self._ahead: int | None = None  # stamp of the last sample, if it was far ahead
        self._forces: list[float] | None = []
        self._first = 0

    def add(self, sample: ImuSample) -> None:
        """Take note of the next sample.

        Raises:
            MeasurementError: for one that is not later than the last, or far from it again.
            RuledgraphError: for readings in another unit.
        """
        last = self._last
        if last is None:
            self._first = sample.stamp
        else:
            self._check_interval(last, sample.stamp)
        self._note(sample.stamp)
        if self._ahead is not None:
            self._last = last  # until the next one is as late
        force = float(np.linalg.norm(sample.accelerometer))
        if self._forces is not None and np.isfinite(force):
            self._forces.append(force)
            if len(self._forces) >= _AVERAGED and sample.stamp - self._first >= _AVERAGED_TIME:
                force, self._forces = float(np.median(self._forces)), None
                if not _MIN_FORCE < force < _MAX_FORCE:
                    raise RuledgraphError(
                        f"the accelerometer reads {force:.3g} on average, not about 9.81: pass "
                        "the gyroscope (rad/s) first, then the accelerometer (m/s^2, not g)"
                    )

    def _check_interval(self, last: int, stamp: int) -> None:
        """Of one sample that is far ahead the stamp may be wrong: the next one shows it."""
        apart = _apart("IMU sample", last, stamp, CLOSEST_SAMPLES)
        before, self._ahead = self._ahead, None
        if apart > MAX_IMU_GAP and before is not None:
            apart = _apart("IMU sample", before, stamp, CLOSEST_SAMPLES)
        elif apart > MAX_IMU_GAP:
            self._ahead = stamp
        self._sparse = self._sparse + 1 if apart > MAX_IMU_GAP else 0
        if self._sparse >= _SPARSE:
            self._last = stamp  # the next one may be near
            raise MeasurementError(
                f"IMU samples come {apart * 1e-9:g} s apart, too far to integrate; check the "
                "unit of their stamps: t= is in seconds, t_ns= in nanoseconds"
            )


class ImageStream(Stream):
    """Frames of a camera."""

    def __init__(self, camera: CameraModel) -> None:
        super().__init__()
        self._camera = camera

    def add(self, frame: Frame) -> None:
        """Take note of the next frame.

        Raises:
            MeasurementError: for one that is not later than the last, or of another size than the
                calibration's.
        """
        if fault := image_fault(frame, self._camera):
            raise MeasurementError(fault)
        if self._last is not None:
            _apart("image", self._last, frame.stamp, CLOSEST_FRAMES)
        self._note(frame.stamp)


def _apart(what: str, last: int, stamp: int, closest: int) -> int:
    apart = stamp - last
    if apart <= 0:
        raise MeasurementError(
            f"an {what} at {seconds(stamp)} s comes after one at {seconds(last)} s, not in order "
            "of time"
        )
    if apart < closest:
        raise MeasurementError(
            f"an {what} comes {apart} ns after the last; check the unit of its stamp: t= is in "
            "seconds, t_ns= in nanoseconds"
        )
    return apart
