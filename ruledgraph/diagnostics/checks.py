# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a recording and a calibration are good for odometry: a line for each thing looked at."""

import itertools
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, Config, RestConfig
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.diagnostics.finding import Finding
from ruledgraph.diagnostics.timing_check import examine_timing
from ruledgraph.imu.rest import imu_rests

_GRAVITY = 9.81
# Fewer measurements are not judged.
_ENOUGH = {"camera": 20, "IMU": 200}
# Fewer images cannot be tracked.
_FEWEST_IMAGES = 5
# Readings in a row that are the same to the last bit, or at the largest value of their axis.
_FROZEN, _SATURATES = 8, 4
# Noise at rest is looked at where the body rests for so long, s.
_REST = 1.0
# m/s^2; what gravity may be off by at rest.
_GRAVITY_ERROR = 0.3
# m/s^2; a camera that is carried or flown shows more.
_MIN_MOTION = 0.3
# Noise at rest beyond what the calibration says, and far below it.
_NOISIER, _QUIETER = 3.0, 1.0 / 50.0
# Of the focal length, in widths of the image; of the principal point, from the middle.
_FOCAL_LENGTHS, _OFF_CENTRE = (0.25, 4.0), 0.15
_LARGEST_LEVER, _LARGEST_OFFSET = 1.0, 0.1
# By how much two models of one camera may differ, in widths of the image, and where it is looked.
_MODELS_DIFFER = 0.01
_PLACES = (12, 9)
# Noise densities of IMUs that are sold: rad/s/sqrt(Hz), m/s^2/sqrt(Hz).
_DENSITIES = {"gyroscope": (3e-6, 2e-2), "accelerometer": (2e-5, 2e-1)}


@dataclass
class Observations:
    """The stamps and the inertial readings of a recording."""

    frame_stamps: "array[int]" = field(default_factory=lambda: array("q"))
    imu_stamps: "array[int]" = field(default_factory=lambda: array("q"))
    readings: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, measurement: Frame | ImuSample) -> None:
        """Note one."""
        if isinstance(measurement, Frame):
            self.frame_stamps.append(measurement.stamp)
        else:
            self.imu_stamps.append(measurement.stamp)
            self.readings.extend(measurement.gyroscope.tolist())
            self.readings.extend(measurement.accelerometer.tolist())

    def times(self, stamps: "array[int]") -> FloatArray:
        """Stamps as s since the recording's first measurement."""
        firsts = [s[0] for s in (self.frame_stamps, self.imu_stamps) if len(s)]
        return np.asarray((np.array(stamps, dtype=np.int64) - min(firsts, default=0)) * 1e-9)

    def liveliest(self, start: float, length: float = 5.0) -> float:
        """Where to begin reading, s, to see the turning: before the most of it, `start` before all.

        Stretches of `length` seconds are compared.
        """
        if len(self.imu_stamps) < _ENOUGH["IMU"]:
            return start
        times = self.times(self.imu_stamps)
        turning = np.linalg.norm(self.imu[:, :3] - np.median(self.imu[:, :3], axis=0), axis=1)
        stretch = (times // length).astype(int)
        counts = np.bincount(stretch)
        means = np.bincount(stretch, turning) / np.maximum(counts, 1)
        # The last one may be but a sample long.
        return start + length * int(np.argmax(np.where(2 * counts >= counts.max(), means, 0.0)))

    @property
    def imu(self) -> FloatArray:
        """Gyroscope and accelerometer, (N, 6)."""
        return np.array(self.readings, dtype=np.float64).reshape(-1, 6)


def examine(
    seen: Observations, noise: ImuNoise | None = None, config: Config = DEFAULTS
) -> Iterator[Finding]:
    """What the measurements show: rates, losses, frozen and saturated sensors, rest and motion.

    Args:
        seen: of the whole recording.
        noise: the calibration's, to compare with.
        config: what counts as rest, and how large the gyroscope's bias may be.
    """
    for name, stamps in (("camera", seen.frame_stamps), ("IMU", seen.imu_stamps)):
        if len(stamps) >= _ENOUGH[name]:
            yield from examine_timing(name, seen.times(stamps))
    if len(seen.imu_stamps) < _ENOUGH["IMU"]:
        return
    times, imu = seen.times(seen.imu_stamps), seen.imu
    yield from _ranges(imu)
    resting = rests(times, imu, config.rest)
    yield from _motion(times, imu, resting, config.rest)
    if resting.any():
        yield from _at_rest(imu[resting].mean(axis=0), config.start.gyroscope_bias)
        if noise is not None:
            yield from _noise_at_rest(times, imu, resting, noise)


def examine_length(seen: Observations, config: Config = DEFAULTS) -> Iterator[Finding]:
    """Whether there are images enough to start, at rest or in motion."""
    times = seen.times(seen.frame_stamps)
    needed = config.start.shortest + config.integrity.trial_time
    if len(times) < _FEWEST_IMAGES:
        when = (
            f"at {times[0]:.2f} s" if len(times) == 1 else f"until {max(times, default=0.0):.2f} s"
        )
        noun = "image" if len(times) == 1 else "images"
        yield Finding(
            False,
            f"only {len(times)} {noun}, {when}: at least 10 Hz for {needed:.1f} s are needed",
        )
    elif times[-1] - times[0] < needed:
        yield Finding(
            False,
            f"the recording is only {times[-1] - times[0]:.1f} s long: a start in motion takes at "
            f"least {needed:.1f} s",
        )


def _ranges(imu: FloatArray) -> Iterator[Finding]:
    same = np.all(imu[1:] == imu[:-1], axis=1)
    frozen = _longest_run(same) + 1
    if frozen > _FROZEN:
        yield Finding(
            False,
            f"the IMU gives the same reading {frozen} times in a row: it was frozen, is padded, or "
            "is simulated without noise",
        )
    for columns, sensor, unit in (
        (slice(0, 3), "gyroscope", "rad/s"),
        (slice(3, 6), "accelerometer", "m/s^2"),
    ):
        values = imu[:, columns]
        for sign in (1.0, -1.0):
            ends = (sign * values).max(axis=0)
            runs = [_longest_run(sign * values[:, i] == ends[i]) for i in range(3)]
            axis = int(np.argmax(runs))
            if runs[axis] >= _SATURATES and not frozen > _FROZEN:
                yield Finding(
                    False,
                    f"the {sensor}'s {'xyz'[axis]} stays at {sign * ends[axis]:.4g} {unit} for "
                    f"{runs[axis]} samples: it is out of its range; set a larger one",
                )


def _motion(
    times: FloatArray, imu: FloatArray, resting: NDArray[np.bool_], rest: RestConfig
) -> Iterator[Finding]:
    forces = imu[:, 3:]
    moving = float(np.linalg.norm(forces - forces.mean(axis=0), axis=1).max())
    still = float(np.mean(resting))
    if moving < _MIN_MOTION or still > 0.99:
        yield Finding(
            False,
            f"it hardly moves: the specific force changes by {moving:.2g} m/s^2 at most; without "
            "acceleration there is no scale",
        )
    else:
        yield Finding(True, f"it moves: the specific force changes by up to {moving:.3g} m/s^2")
    begin = times < times[0] + rest.duration
    if imu_rests(times[begin], imu[begin], rest):
        yield Finding(True, "it starts at rest")
    else:
        yield Finding(
            False,
            "it starts in motion, which takes a second with six lines and changing acceleration; "
            "best hold still for a second first",
        )
    if not resting.any():
        yield Finding(
            False,
            f"it never rests for {_REST:g} s: gravity and the IMU's noise cannot be compared",
        )


def rests(
    times: FloatArray, imu: FloatArray, rest: RestConfig = DEFAULTS.rest
) -> NDArray[np.bool_]:
    """Which samples lie in a stretch of rest, (N,).

    Args:
        times: of the samples, s.
        imu: gyroscope and accelerometer, (N, 6).
        rest: what counts as rest.
    """
    resting = np.zeros(len(times), dtype=bool)
    edges = np.searchsorted(times, np.arange(times[0], times[-1], _REST))
    for first, last in itertools.pairwise(edges.tolist()):
        part = slice(first, last)
        # A gap shows no rest.
        if last - first > 10 and imu_rests(times[part], imu[part], rest):
            resting[part] = True
    return resting


def _at_rest(mean: FloatArray, bias_sigma: float) -> Iterator[Finding]:
    """Of the mean of gyroscope and accelerometer at rest, (6,)."""
    gravity, bias = float(np.linalg.norm(mean[3:])), float(np.linalg.norm(mean[:3]))
    if abs(gravity - _GRAVITY) > _GRAVITY_ERROR:
        yield Finding(
            False,
            f"at rest the accelerometer shows {gravity:.2f} instead of 9.81 m/s^2; check its unit, "
            "scale and bias",
        )
    else:
        yield Finding(True, f"at rest the accelerometer shows {gravity:.2f} m/s^2")
    if bias > bias_sigma:
        yield Finding(
            False,
            f"at rest the gyroscope shows {bias:.2g} rad/s; calibrate it, or raise "
            "--set start.gyroscope_bias",
        )


def _noise_at_rest(
    times: FloatArray, imu: FloatArray, resting: NDArray[np.bool_], noise: ImuNoise
) -> Iterator[Finding]:
    both = resting[1:] & resting[:-1]
    step = float(np.median(np.diff(times)))
    # Differences leave out what drifts.
    density = np.diff(imu, axis=0)[both].std(axis=0) / np.sqrt(2.0) * np.sqrt(step)
    for name, found, said, unit in (
        ("gyroscope", density[:3].max(), noise.gyroscope, "rad/s/sqrt(Hz)"),
        ("accelerometer", density[3:].max(), noise.accelerometer, "m/s^2/sqrt(Hz)"),
    ):
        ratio = float(found) / said
        text = f"the {name}'s noise at rest is {found:.2g} {unit}, {ratio:.2g} times the"
        if ratio > _NOISIER:
            yield Finding(False, f"{text} calibration's; raise that, or mount it softer")
        elif ratio < _QUIETER:
            yield Finding(False, f"{text} calibration's; is that in the right unit?")
        else:
            yield Finding(True, f"{text} calibration's")


def examine_calibration(
    calibration: Calibration, image_size: tuple[int, int] | None
) -> Iterator[Finding]:
    """Whether the figures can be those of a camera, an IMU and how they are mounted.

    Args:
        calibration: as read.
        image_size: width and height of the recording's images.
    """
    camera = calibration.camera
    if image_size is not None and image_size != (camera.width, camera.height):
        yield Finding(
            False,
            f"images are {image_size[0]}x{image_size[1]}, the calibration is for {camera.width}x"
            f"{camera.height}; use that of this camera and resolution",
        )
    yield _intrinsics(camera)
    lever = float(np.linalg.norm(calibration.body_T_cam.translation()))
    if lever > _LARGEST_LEVER:
        yield Finding(
            False, f"the camera is {lever:.3g} m from the IMU; is its translation in metres?"
        )
    else:
        yield Finding(True, f"the camera is {1e3 * lever:.3g} mm from the IMU")
    if abs(calibration.time_offset) > _LARGEST_OFFSET:
        yield Finding(
            False, f"the time offset of {calibration.time_offset:.3g} s is large; is it in seconds?"
        )
    for name, (least, most) in _DENSITIES.items():
        density = getattr(calibration.imu_noise, name)
        if not least <= density <= most:
            yield Finding(
                False,
                f"the {name}'s noise density of {density:.2g} is no IMU's; densities are in SI "
                "units by the root of Hz, not deviations of samples",
            )


def examine_camera_info(camera: CameraModel, recorded: CameraModel) -> Iterator[Finding]:
    """Whether a calibration's camera is the one that the recording's CameraInfo tells of.

    They may both be right and differ by a pixel or two; another resolution's calibration, or one of
    the image before it was rectified, differs by far more.
    """
    if (recorded.width, recorded.height) != (camera.width, camera.height):
        return  # images have one size, and that is looked at
    grid = np.meshgrid(*(np.linspace(0.1, 0.9, places) for places in _PLACES))
    pixels = np.stack(grid, axis=-1).reshape(-1, 2) * [camera.width, camera.height]
    apart = np.linalg.norm(recorded.distort(camera.undistort(pixels)).pixels - pixels, axis=1)
    usual = float(np.nanmedian(apart))
    if usual < _MODELS_DIFFER * camera.width:
        yield Finding(True, f"calibration and camera_info differ by {usual:.2g} px (median)")
    else:
        yield Finding(
            False,
            f"calibration and the recording's camera_info differ by {usual:.3g} px (focal lengths "
            f"{camera.fx:.4g} and {recorded.fx:.4g}); use the calibration of this camera, "
            "resolution and rectification",
        )


def _intrinsics(camera: CameraModel) -> Finding:
    focal = camera.focal_length / camera.width
    least, most = _FOCAL_LENGTHS
    view = np.degrees(2.0 * np.arctan(0.5 / focal))
    if not least < focal < most or not 0.8 < camera.fx / camera.fy < 1.25:
        return Finding(
            False,
            f"focal lengths of {camera.fx:.4g} and {camera.fy:.4g} px are odd for images of "
            f"{camera.width}x{camera.height}; is it another resolution's calibration?",
        )
    off = max(
        abs(camera.cx / camera.width - 0.5),
        abs(camera.cy / camera.height - 0.5),
    )
    if off > _OFF_CENTRE:
        return Finding(
            False,
            f"the principal point ({camera.cx:.4g}, {camera.cy:.4g}) is far from the middle of "
            f"{camera.width}x{camera.height}; is it of a cropped image?",
        )
    return Finding(True, f"the camera sees {view:.0f} degrees across (without distortion)")


def _longest_run(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))
