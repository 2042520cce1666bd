# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The inertial side of the stream: two half IMUs made one, repeated stamps, gaps."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.measurements import MAX_IMU_GAP, Frame, Gap, ImuSample, Measurement
from ruledgraph.recording.report import Report


class Gyroscope(NamedTuple):
    """Angular velocity alone, (3,), rad/s."""

    stamp: int
    vector: NDArray[np.float64]


class Accelerometer(NamedTuple):
    """Specific force alone, (3,), m/s^2."""

    stamp: int
    vector: NDArray[np.float64]


Part: TypeAlias = Frame | ImuSample | Gyroscope | Accelerometer


def interpolate_accelerometer(parts: Iterable[Part], report: Report) -> Iterator[Frame | ImuSample]:
    """Give every gyroscope sample the specific force at its time, linearly interpolated.

    What comes after the latest accelerometer sample waits for the next. Gyroscope samples without
    accelerometer samples around them, at most `MAX_IMU_GAP` apart, are dropped.
    """
    waiting: deque[Frame | ImuSample | Gyroscope] = deque()
    before: Accelerometer | None = None
    for part in parts:
        if isinstance(part, Accelerometer):
            yield from _resolve(waiting, before, part, report)
            before = part
        else:
            waiting.append(part)
            if before is None or part.stamp - before.stamp > MAX_IMU_GAP:
                yield from _resolve(waiting, None, None, report)
    yield from _resolve(waiting, None, None, report)


def _resolve(
    waiting: deque[Frame | ImuSample | Gyroscope],
    before: Accelerometer | None,
    after: Accelerometer | None,
    report: Report,
) -> Iterator[Frame | ImuSample]:
    """Empty the queue, whose parts lie between two accelerometer samples."""
    usable = before and after and 0 < after.stamp - before.stamp <= MAX_IMU_GAP
    while waiting:
        part = waiting.popleft()
        if not isinstance(part, Gyroscope):
            yield part
        elif before and after and usable:
            share = (part.stamp - before.stamp) / (after.stamp - before.stamp)
            force = before.vector + share * (after.vector - before.vector)
            yield ImuSample(part.stamp, part.vector, force)
        else:
            report.skipped_imu["no accelerometer sample before or after it"] += 1


def mark_gaps(measurements: Iterable[Frame | ImuSample], report: Report) -> Iterator[Measurement]:
    """Drop repeated stamps, tell of gaps of the IMU, drop the frames in them, count the rest.

    A frame is in a gap when the IMU has been silent for longer than `MAX_IMU_GAP`; frames before
    the first IMU sample are passed on.
    """
    sample_stamp = frame_stamp = -1
    for measurement in measurements:
        stamp = measurement.stamp
        if isinstance(measurement, ImuSample):
            if stamp == sample_stamp:
                report.skipped_imu["its stamp repeats the one before"] += 1
                continue
            if 0 <= sample_stamp < stamp - MAX_IMU_GAP:
                gap = Gap(sample_stamp, stamp)
                report.imu_gaps.append(gap)
                yield gap
            sample_stamp = stamp
        else:
            if stamp == frame_stamp:
                report.skipped_frames["its stamp repeats the one before"] += 1
                continue
            if 0 <= sample_stamp < stamp - MAX_IMU_GAP:
                report.skipped_frames["the IMU is silent around it"] += 1
                continue
            frame_stamp = stamp
        report.add(measurement)
        yield measurement
