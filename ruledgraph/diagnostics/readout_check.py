# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a rolling shutter's readout fits between the frames."""

from collections.abc import Iterator

import numpy as np

from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.diagnostics.checks import Finding


def examine_readout(calibration: Calibration, frame_times: FloatArray) -> Iterator[Finding]:
    """What the calibration says of the rows' times.

    Args:
        calibration: as read.
        frame_times: of the recording, s.
    """
    readout = calibration.readout
    if not readout:
        return
    interval = float(np.median(np.diff(frame_times))) if len(frame_times) > 1 else np.inf
    if readout > interval:
        yield Finding(
            False,
            f"rows are read within {1e3 * readout:.1f} ms, but frames are {1e3 * interval:.1f} ms "
            "apart; line_delay is in s per row, --readout in s",
        )
    else:
        yield Finding(True, f"a rolling shutter: rows are read within {1e3 * readout:.1f} ms")
