# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the images turn as the gyroscope says: mounting, clock, and unit of the gyroscope.

`initialization.time_offset_finder` and `initialization.mounting_check` say how it is found.
"""

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, Config
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.diagnostics.finding import Finding
from ruledgraph.diagnostics.readout_check import compare_readout
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.mounting_check import (
    BETTER,
    MIN_PAIRS,
    MountingCheck,
    check_mounting,
)
from ruledgraph.initialization.rotation_fit import RotationFit
from ruledgraph.initialization.time_offset_finder import RANGE, TimeOffsetFinder, covered
from ruledgraph_factors import ImuSamples

_MAX_PAIRS = 80
# An offset is told when it is significant, standard deviations, and large enough to matter, s.
_SIGNIFICANT, _LARGE = 3.0, 0.005
# Offsets so far from the calibration's are searched, in such steps, by every so many pairs, s: the
# turning of hands and vehicles changes little within half a step.
_FARTHEST, _FAR_STEP, _EVERY = 1.0, 0.05, 2


def check_rotation(
    measurements: Iterable[Measurement], calibration: Calibration, config: Config = DEFAULTS
) -> Iterator[Finding]:
    """Compare the rotation of the images with the gyroscope's.

    Args:
        measurements: a stretch of a recording; the first of it that suffices is used.
        calibration: that is checked.
        config: what is known of the gyroscope's bias, and whether the images replace the rotation.
    """
    bias_sigma = config.start.gyroscope_bias
    read = _read(measurements, calibration, bias_sigma)
    if read is None:
        return
    all_pairs, samples = read
    pairs = covered(all_pairs, samples, calibration.time_offset)
    mounting = check_mounting(pairs, samples, calibration, bias_sigma)
    if mounting is None:
        return
    found = mounting.time_offset
    if mounting.wrong or not mounting.is_usual or found is None:
        if _fits_in_degrees(pairs, samples, calibration, bias_sigma, mounting):
            yield Finding(
                False,
                f"image points disagree with the gyroscope by {mounting.error:.2g} px, and fit it "
                "if it is in degrees per second: record rad/s (multiply by 0.017453)",
            )
            return
        far = _far_offset(all_pairs, samples, calibration, bias_sigma, mounting)
        if far is not None:
            yield Finding(False, _offset_text(*far, calibration))
            return
    if mounting.wrong:
        yield Finding(False, mounting.message(from_images=config.extrinsics.from_images))
        return
    if mounting.is_usual:
        yield Finding(True, f"the images turn as the gyroscope says, to {mounting.error:.2g} px")
    else:
        yield Finding(
            False,
            f"image points disagree with the gyroscope by {mounting.error:.2g} px, 0.1 to 0.15 are "
            "usual: check T_cam_imu, the intrinsics, and the unit and axes of the IMU",
        )
    yield from compare_readout(pairs, samples, calibration, bias_sigma)
    if found is None:
        return
    change = abs(found.value - calibration.time_offset)
    if change > max(_SIGNIFICANT * found.sigma, _LARGE):
        yield Finding(False, _offset_text(found.value, found.sigma, calibration))


def _read(
    measurements: Iterable[Measurement], calibration: Calibration, bias_sigma: float
) -> tuple[PointPairs, ImuSamples] | None:
    """The first pairs of images, and the IMU's samples until the largest offset after them."""
    origin: int | None = None
    times: list[float] = []
    readings: list[FloatArray] = []
    finder = TimeOffsetFinder(calibration, bias_sigma, _MAX_PAIRS)
    camera = calibration.camera
    last = np.inf
    for m in measurements:
        if isinstance(m, ImuSample):
            origin = m.stamp if origin is None else origin
            times.append((m.stamp - origin) * 1e-9)
            readings.append(np.concatenate([m.gyroscope, m.accelerometer]))
            if times[-1] > last:
                break
        elif isinstance(m, Frame) and origin is not None and np.isinf(last):
            if m.image.shape != (camera.height, camera.width) or finder.count >= _MAX_PAIRS:
                last = times[-1] + calibration.time_offset + _FARTHEST + 2.0 * RANGE
            else:
                finder.add_image((m.stamp - origin) * 1e-9, m.image)
    if len(times) < 2:
        return None
    values = np.array(readings)
    return finder.pairs, ImuSamples(times, values[:, :3], values[:, 3:])


def _fits_in_degrees(
    pairs: PointPairs,
    samples: ImuSamples,
    calibration: Calibration,
    bias_sigma: float,
    mounting: MountingCheck,
) -> bool:
    """Whether the gyroscope fits the images if it is in degrees per second."""
    scaled = ImuSamples(samples.times, np.radians(samples.gyroscope), samples.accelerometer)
    check = check_mounting(pairs, scaled, calibration, bias_sigma)
    return check is not None and _explains(check, mounting)


def _far_offset(
    pairs: PointPairs,
    samples: ImuSamples,
    calibration: Calibration,
    bias_sigma: float,
    mounting: MountingCheck,
) -> tuple[float, float] | None:
    """An offset outside of the usual range with which the images fit the gyroscope, if any, and its
    standard deviation, s.
    """
    steps = round(_FARTHEST / _FAR_STEP)
    offsets = [calibration.time_offset + _FAR_STEP * i for i in range(-steps, steps + 1)]
    some = PointPairs(*(rows[::_EVERY] for rows in pairs))
    errors = []
    for offset in offsets:
        there = covered(some, samples, offset)
        if len(there.times) < MIN_PAIRS:
            errors.append(np.inf)
            continue
        fit = RotationFit(there, samples, calibration, bias_sigma)
        errors.append(fit.error(fit.best_at(offset)))
    shifted = dataclasses.replace(calibration, time_offset=offsets[int(np.argmin(errors))])
    there = covered(pairs, samples, shifted.time_offset)
    check = check_mounting(there, samples, shifted, bias_sigma)
    if check is None or not _explains(check, mounting):
        return None
    found = check.time_offset
    # Where the motion does not show it to milliseconds the step found is good enough to go on with.
    return (found.value, found.sigma) if found else (shifted.time_offset, 0.5 * _FAR_STEP)


def _explains(check: MountingCheck, mounting: MountingCheck) -> bool:
    """Whether another clock or unit explains the points far better, as another mounting would have
    to, and better than those do.
    """
    others = min(BETTER * mounting.error, mounting.other, mounting.mirrored)
    return check.is_usual and not check.wrong and check.error < others


def _offset_text(value: float, sigma: float, calibration: Calibration) -> str:
    return (
        f"the images fit the gyroscope best {1e3 * value:.1f} ± {1e3 * sigma:.1f} ms later, the "
        f"calibration says {1e3 * calibration.time_offset:.0f} ms; smooth with --time-offset "
        f"{value:.4f}, or write timeshift_cam_imu: {value:.4f}"
    )
