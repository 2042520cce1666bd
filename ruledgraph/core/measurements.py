# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the sensors deliver. Recordings and simulator produce it, the odometry consumes it.

Stamps are nanoseconds as in the recording (int64 range); the camera's and the IMU's clock may
differ by the calibration's time offset.
"""

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruledgraph.core.errors import MeasurementError

# Stamps are int64 nanoseconds: until the year 2262.
_LAST_SECOND = 2**63 // 10**9
# No IMU of a hand-held or flying body reads more, rad/s and m/s^2.
_FASTEST_TURN, _LARGEST_FORCE = 120.0, 5000.0

STAMP_JITTER = 4_000_000
"""ns; frames that come so much before their time are on time: well below a frame at 90 Hz."""

MAX_IMU_GAP = 500_000_000
"""ns; across a longer silence of the IMU its samples are neither interpolated nor integrated."""


@dataclass(frozen=True, eq=False)
class Frame:
    """An image: grey, (height, width) uint8, which does not change afterwards: it may be read by
    another thread, and compared with the next one. Pass a copy if you reuse the buffer.
    """

    stamp: int
    image: NDArray[np.uint8]
    encoded: bytes | None = None
    """The PNG or JPEG it was recorded as, where that is asked for."""

    @classmethod
    def of(cls, image: ArrayLike, *, t: float | None = None, t_ns: int | None = None) -> "Frame":
        """A frame of a copy of an image, made grey.

        Args:
            image: 8 bit: grey (height, width) or (height, width, 1), BGR (height, width, 3) or
                BGRA (height, width, 4).
            t: its stamp in seconds; or
            t_ns: in nanoseconds.

        Raises:
            MeasurementError: for anything else.
        """
        return cls(stamp_of(t, t_ns), _grey(image))


class ImuSample(NamedTuple):
    """Angular velocity (3,), rad/s, and specific force (3,), m/s^2, in the body frame."""

    stamp: int
    gyroscope: NDArray[np.float64]
    accelerometer: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        gyroscope: ArrayLike,
        accelerometer: ArrayLike,
        *,
        t: float | None = None,
        t_ns: int | None = None,
    ) -> "ImuSample":
        """A sample of copies of two readings.

        Args:
            gyroscope: angular velocity (3,), rad/s.
            accelerometer: specific force (3,), m/s^2: at rest 9.81 upwards.
            t: the stamp in seconds; or
            t_ns: in nanoseconds.

        Raises:
            MeasurementError: for another shape, or what no IMU reads in these units. NaN and
                infinity are the sensor's fault: the odometry leaves such a sample out.
        """
        return cls(
            stamp_of(t, t_ns),
            _reading("gyroscope", gyroscope, _FASTEST_TURN, "rad/s, not degrees"),
            _reading("accelerometer", accelerometer, _LARGEST_FORCE, "m/s^2"),
        )


class Gap(NamedTuple):
    """The IMU was silent from `start` to `stop`, its samples before and after, for too long to
    integrate across: one segment of the motion ended, a new one begins.
    """

    start: int
    stop: int


Measurement: TypeAlias = Frame | ImuSample | Gap
"""In time order; a gap comes at its `stop`, just before the sample that ends it."""


def stamp_of(t: float | None = None, t_ns: int | None = None) -> int:
    """A stamp in ns, of seconds or of nanoseconds; exactly one must be given.

    Raises:
        MeasurementError: for none or both, another type, NaN, or a time before 0 or after 2262.
    """
    if (t is None) == (t_ns is None):
        raise MeasurementError("pass the time as t=, in seconds, or as t_ns=, in nanoseconds")
    if t_ns is not None:
        if isinstance(t_ns, bool) or not isinstance(t_ns, Integral):
            raise MeasurementError(
                f"t_ns = {t_ns!r} is no whole number of nanoseconds; pass seconds as t="
            )
        stamp = int(t_ns)
    else:
        if isinstance(t, bool) or not isinstance(t, Real) or not math.isfinite(t):
            raise MeasurementError(f"t = {t!r} is no time in seconds")
        if t >= _LAST_SECOND:
            raise MeasurementError(
                f"t = {float(t):g} s is after the year 2262; pass nanoseconds as t_ns="
            )
        # Of whole seconds and the rest apart: float64 holds ns only within 104 days.
        whole = math.floor(t)
        stamp = whole * 10**9 + round((float(t) - whole) * 1e9)
    if not 0 <= stamp < 2**63:
        raise MeasurementError(f"a stamp of {stamp} ns is not within 0 to 2^63")
    return stamp


def _reading(name: str, values: ArrayLike, largest: float, unit: str) -> NDArray[np.float64]:
    given: Any = np.asarray(values)
    if given.shape != (3,) or given.dtype.kind not in "fiu":
        raise MeasurementError(
            f"{name}: 3 numbers are wanted, x, y and z, not {given.dtype} of shape {given.shape}"
        )
    reading = np.array(given, dtype=np.float64)
    if np.isfinite(reading).all() and np.abs(reading).max() > largest:
        raise MeasurementError(f"{name}: no IMU reads {reading.tolist()}; pass {unit}")
    return reading


def _grey(image: ArrayLike) -> NDArray[np.uint8]:
    given: Any = image
    if not hasattr(image, "dtype"):  # a list: numpy would make it int64
        try:
            given = np.array(image, dtype=np.uint8)
        except (ValueError, TypeError, OverflowError) as error:
            raise MeasurementError(f"image: no array of 8 bit pixels: {error}") from None
    given = np.asarray(given)
    if given.dtype != np.uint8:
        raise MeasurementError(f"image: {given.dtype} pixels; convert them to 8 bit, uint8")
    channels = given.shape[2] if given.ndim == 3 else 1
    if given.ndim not in (2, 3) or channels not in (1, 3, 4) or given.size == 0:
        raise MeasurementError(
            f"image: shape {given.shape}; grey is (height, width), BGR (height, width, 3)"
        )
    if channels == 1:
        return np.array(given.reshape(given.shape[:2]), order="C")
    import cv2  # it takes long to load, and grey images can do without

    code = cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(given), code), dtype=np.uint8)
