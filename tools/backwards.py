# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings played backwards: real images and a real IMU, in a motion that nobody has recorded.

Newton's laws hold backwards, too. With t' = T - t poses and specific forces are the same, and
velocities and angular rates change their signs. Take-offs become landings; what was seen last is
seen first.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.evaluation.ground_truth import GroundTruth
from variants import turned_camera


def played_backwards(measurements: Iterable[Measurement]) -> tuple[list[Measurement], int]:
    """A recording backwards, and T, ns: the sum of a stamp's value before and after.

    Images are turned by half a turn, see `backward_calibration`. All of them are held in memory.
    """
    recorded = list(measurements)
    stamps = [item.stop if isinstance(item, Gap) else item.stamp for item in recorded]
    total = min(stamps, default=0) + max(stamps, default=0)
    return [_backwards(item, total) for item in reversed(recorded)], total


def _backwards(item: Measurement, total: int) -> Measurement:
    if isinstance(item, Frame):
        return Frame(total - item.stamp, np.ascontiguousarray(np.rot90(item.image, 2)))
    if isinstance(item, ImuSample):
        return ImuSample(total - item.stamp, -item.gyroscope, item.accelerometer)
    return Gap(total - item.stop, total - item.start)


def backward_calibration(calibration: Calibration) -> Calibration:
    """Of a recording played backwards. The camera is turned by half a turn about its axis: so the
    rows of a rolling shutter are read from the top to the bottom.

    The time offset of such a shutter is off by its readout, as stamps are those of the last row.
    """
    return replace(turned_camera(calibration, 2), time_offset=0.0 - calibration.time_offset)


def backward_truth(truth: GroundTruth, total: int) -> GroundTruth:
    """Ground truth of a recording played backwards, see `played_backwards`."""
    quaternions = None if truth.quaternions is None else truth.quaternions[::-1]
    return GroundTruth(total - truth.stamps[::-1], truth.positions[::-1], quaternions)
