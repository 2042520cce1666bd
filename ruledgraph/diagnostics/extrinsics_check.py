# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the images turn as the gyroscope says: is the mounting the right way round, the clock?

`initialization.time_offset_finder` and `initialization.mounting_check` say how it is found.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import DEFAULTS, StartConfig
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.diagnostics.finding import Finding
from ruledgraph.diagnostics.readout_check import compare_readout
from ruledgraph.initialization.mounting_check import check_mounting
from ruledgraph.initialization.time_offset_finder import TimeOffsetFinder, covered, fit_offset
from ruledgraph_factors import ImuSamples

_MAX_PAIRS = 80
# An offset is told when it is significant, standard deviations, and large enough to matter, s.
_SIGNIFICANT, _LARGE = 3.0, 0.005


def check_rotation(
    measurements: Iterable[Measurement],
    calibration: Calibration,
    start: StartConfig = DEFAULTS.start,
) -> Iterator[Finding]:
    """Compare the rotation of the images with the gyroscope's.

    Args:
        measurements: a stretch of a recording; the first of it that suffices is used.
        calibration: that is checked.
        start: what is known of the gyroscope's bias.
    """
    origin: int | None = None
    times, readings = [], []
    bias_sigma = start.gyroscope_bias
    finder = TimeOffsetFinder(calibration, bias_sigma, _MAX_PAIRS)
    camera = calibration.camera
    for m in measurements:
        if isinstance(m, ImuSample):
            origin = m.stamp if origin is None else origin
            times.append((m.stamp - origin) * 1e-9)
            readings.append(np.concatenate([m.gyroscope, m.accelerometer]))
        elif isinstance(m, Frame) and origin is not None:
            if m.image.shape != (camera.height, camera.width) or finder.count >= _MAX_PAIRS:
                break
            finder.add_image((m.stamp - origin) * 1e-9, m.image)
    if len(times) < 2:
        return
    values = np.array(readings)
    samples = ImuSamples(times, values[:, :3], values[:, 3:])
    pairs = covered(finder.pairs, samples, calibration.time_offset)
    mounting = check_mounting(pairs, samples, calibration, bias_sigma)
    if mounting is None:
        return
    if mounting.wrong:
        yield Finding(False, mounting.text)
        return
    text = f"the images turn as the gyroscope says, to {mounting.error:.2g} px"
    if not mounting.is_usual:
        usual = "where 0.1 to 0.15 are usual"
        text += f", {usual}: check T_cam_imu, the intrinsics, and the unit and axes of the IMU"
    yield Finding(mounting.is_usual, text)
    yield from compare_readout(pairs, samples, calibration, bias_sigma)
    found = fit_offset(pairs, samples, calibration, bias_sigma)
    if found is None:
        return
    change = abs(found.value - calibration.time_offset)
    if change > max(_SIGNIFICANT * found.sigma, _LARGE):
        yield Finding(
            False,
            f"the images fit the gyroscope best {1e3 * found.value:.1f} ± "
            f"{1e3 * found.sigma:.1f} ms later, the calibration says "
            f"{1e3 * calibration.time_offset:.0f} ms; write timeshift_cam_imu: {found.value:.4f}",
        )
