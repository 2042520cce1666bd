# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A rolling shutter's readout: does it fit between the frames, and do the images speak for it?"""

from collections.abc import Iterator

import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.diagnostics.finding import Finding
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.readout import estimated_readout
from ruledgraph_factors import ImuSamples

# So far from the calibration's it matters, s.
_LARGE = 0.005


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


def compare_readout(
    pairs: PointPairs, samples: ImuSamples, calibration: Calibration, bias_sigma: float
) -> Iterator[Finding]:
    """Whether the images speak for another readout than the calibration's; as that is estimated."""
    found = estimated_readout(pairs, samples, calibration, bias_sigma)
    if found is None or not found.is_certain or abs(found.value - calibration.readout) < _LARGE:
        return
    line_delay = calibration.with_readout(found.value).line_delay
    yield Finding(
        False,
        f"the images fit the gyroscope best with rows read within {1e3 * found.value:.0f} ± "
        f"{1e3 * found.sigma:.0f} ms, the calibration says "
        f"{1e3 * calibration.readout:.0f} ms; try --readout {found.value:.3f}, or write "
        f"line_delay: {line_delay:.2e}",
    )
