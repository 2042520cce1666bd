# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A whole recording's live estimates in one call."""

from collections.abc import Iterable, Iterator

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Measurement
from ruledgraph.odometry import Odometry


def smooth(
    measurements: Iterable[Measurement],
    calibration: Calibration,
    config: Config | None = None,
) -> Iterator[Estimate]:
    """Live estimates, one for each frame from the start on, of a recording's `stream()`.

    For smoothed estimates and lines use `Odometry`.
    """
    odometry = Odometry(calibration, config)
    for measurement in measurements:
        odometry.add(measurement)
        yield from odometry.take_live()
        odometry.take_smoothed()
        odometry.take_lines()
    odometry.finish()
    yield from odometry.take_live()
