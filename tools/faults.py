# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong with a camera and an IMU: changes of a stream of measurements, or of a
calibration.

Each fault takes measurements and gives measurements back; it holds back no more than it must and
gives the same for the same seed. Times are s after the first measurement.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import cv2
import gtsam
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.sensors import Calibration, ImuNoise
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement

Fault = Callable[[Iterable[Measurement]], Iterator[Measurement]]
Image = NDArray[np.uint8]

_NS = 1e9


def none(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
    """Nothing: for comparison."""
    yield from measurements


def chain(*faults: Fault) -> Fault:
    """One after the other."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        for fault in faults:
            measurements = fault(measurements)
        yield from measurements

    return apply


# -- messages --------------------------------------------------------------------------------------


def drop_frames(share: float, seed: int = 0) -> Fault:
    """Lose a share of the frames, at random."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        rng = np.random.default_rng([seed, 1])
        for m in measurements:
            if not isinstance(m, Frame) or rng.random() >= share:
                yield m

    return apply


def silent_imu(start: float, length: float, every: float | None = None) -> Fault:
    """Lose the IMU from `start` for `length`, and again `every` so many seconds.

    A silence is announced by a `Gap` only where a recording's reader does that.
    """

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        for time, m in _timed(measurements):
            phase = time - start if every is None or time < start else (time - start) % every
            if not (isinstance(m, ImuSample) and 0.0 <= phase < length):
                yield m

    return apply


def swapped(share: float, seed: int = 0) -> Fault:
    """Neighbouring messages change places."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        rng = np.random.default_rng([seed, 2])
        held: Measurement | None = None
        for m in measurements:
            if held is not None:
                yield m
                yield held
                held = None
            elif rng.random() < share:
                held = m
            else:
                yield m
        if held is not None:
            yield held

    return apply


def late(kind: type[Frame] | type[ImuSample], seconds: float, share: float, seed: int = 0) -> Fault:
    """A share of the messages of one kind arrives late, with its right stamp."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        rng = np.random.default_rng([seed, 3])
        waiting: deque[tuple[float, Measurement]] = deque()
        for time, m in _timed(measurements):
            while waiting and waiting[0][0] <= time:
                yield waiting.popleft()[1]
            if isinstance(m, kind) and rng.random() < share:
                waiting.append((time + seconds, m))
            else:
                yield m
        for _, m in waiting:
            yield m

    return apply


def shifted_frames(seconds: float) -> Fault:
    """Stamps of frames off by a constant; a stream is still in order of its stamps."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        shift = round(seconds * _NS)
        # Messages wait until none with an earlier stamp can follow.
        waiting: list[Measurement] = []
        for m in measurements:
            moved = replace(m, stamp=m.stamp + shift) if isinstance(m, Frame) else m
            waiting.append(moved)
            done = _stamp(m) - abs(shift)
            waiting.sort(key=_stamp)
            while waiting and _stamp(waiting[0]) <= done:
                yield waiting.pop(0)
        yield from waiting

    return apply


# -- the IMU ---------------------------------------------------------------------------------------


def saturated(gyroscope: float, accelerometer: float) -> Fault:
    """Readings of each axis end at these, rad/s and m/s^2."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        for m in measurements:
            if isinstance(m, ImuSample):
                rate = np.clip(m.gyroscope, -gyroscope, gyroscope)
                yield ImuSample(
                    m.stamp, rate, np.clip(m.accelerometer, -accelerometer, accelerometer)
                )
            else:
                yield m

    return apply


def repeated(kind: type[Frame] | type[ImuSample], start: float, length: float) -> Fault:
    """A sensor that hangs: its last image or reading again and again, with new stamps."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        last: Frame | ImuSample | None = None
        for time, m in _timed(measurements):
            if isinstance(m, kind) and last is not None and start <= time < start + length:
                again = _stamp(m)
                yield (
                    replace(last, stamp=again)
                    if isinstance(last, Frame)
                    else last._replace(stamp=again)
                )
                continue
            if isinstance(m, (Frame, ImuSample)) and isinstance(m, kind):
                last = m
            yield m

    return apply


def spikes(share: float, size: float, seed: int = 0) -> Fault:
    """Single readings far off, of the gyroscope (rad/s) and ten times that of the accelerometer."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        rng = np.random.default_rng([seed, 4])
        for m in measurements:
            if isinstance(m, ImuSample) and rng.random() < share:
                rate, force = rng.normal(size=(2, 3)) * size
                yield ImuSample(m.stamp, m.gyroscope + rate, m.accelerometer + 10.0 * force)
            else:
                yield m

    return apply


# -- images ----------------------------------------------------------------------------------------


def of_images(change: Callable[[Image, float], Image], start: float, length: float) -> Fault:
    """Change the images from `start` for `length`; `change` is given the time."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        for time, m in _timed(measurements):
            if isinstance(m, Frame) and start <= time < start + length:
                yield Frame(m.stamp, change(m.image, time))
            else:
                yield m

    return apply


def exposure_jumps(gains: tuple[float, ...], every: float) -> Callable[[Image, float], Image]:
    """The brightness jumps from one gain to the next, `every` so many seconds."""

    def change(image: Image, time: float) -> Image:
        return np.asarray(
            cv2.convertScaleAbs(image, alpha=gains[int(time / every) % len(gains)]), np.uint8
        )

    return change


def blurred(pixels: int) -> Callable[[Image, float], Image]:
    """As by a long exposure: smeared so far, in a direction that turns."""

    def change(image: Image, time: float) -> Image:
        kernel = np.zeros((pixels, pixels), np.float32)
        half = 0.5 * (pixels - 1)
        reach = half * np.array([np.cos(3.0 * time), np.sin(3.0 * time)])
        ends = [np.round(half + sign * reach).astype(int).tolist() for sign in (-1.0, 1.0)]
        cv2.line(kernel, ends[0], ends[1], 1.0)
        return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.uint8)

    return change


def covered(grey: int = 0, noise: float = 1.0) -> Callable[[Image, float], Image]:
    """A hand before the lens, or a blank wall: one grey and the sensor's noise."""

    def change(image: Image, time: float) -> Image:
        rng = np.random.default_rng(round(time * _NS))
        return np.clip(grey + noise * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)

    return change


def moving_object(width: float = 1 / 3, speed: float = 0.15) -> Callable[[Image, float], Image]:
    """A striped board as wide as `width` of the image goes to and fro before the scene.

    Its edges are straight and move by `speed` image widths a second.
    """

    def change(image: Image, time: float) -> Image:
        rows, columns = image.shape
        board = round(width * columns)
        u = (time * speed / (1.0 - width)) % 2.0
        first = (1.0 - width) * columns * (u if u < 1.0 else 2.0 - u)
        stripes = np.full((rows, board), 210, np.uint8)
        for i in range(0, board, max(board // 4, 1)):
            stripes[:, i : i + max(board // 8, 1)] = 40
        changed = image.copy()
        # By whole and half pixels alike.
        shift = np.array([[1.0, 0.0, first], [0.0, 1.0, 0.0]])
        cover = cv2.warpAffine(np.ones_like(stripes, np.float32), shift, (columns, rows))
        there = cv2.warpAffine(stripes.astype(np.float32), shift, (columns, rows))
        changed[...] = np.clip(image * (1.0 - cover) + there, 0, 255)
        return changed

    return change


# -- calibration -----------------------------------------------------------------------------------


def turned_camera(calibration: Calibration, degrees: float) -> Calibration:
    """The camera is mounted otherwise than said, turned about a skew axis."""
    axis = np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    turn = gtsam.Pose3(gtsam.Rot3.Expmap(np.radians(degrees) * axis), np.zeros(3))
    return replace(calibration, body_T_cam=calibration.body_T_cam.compose(turn))


def moved_camera(calibration: Calibration, metres: float) -> Calibration:
    """The camera is mounted so far from where it is said to be."""
    pose = calibration.body_T_cam
    shift = metres * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    moved = gtsam.Pose3(pose.rotation(), pose.translation() + shift)
    return replace(calibration, body_T_cam=moved)


def scaled_noise(calibration: Calibration, factor: float) -> Calibration:
    """The IMU's noise figures are off by a factor."""
    noise = ImuNoise(*(factor * value for value in vars(calibration.imu_noise).values()))
    return replace(calibration, imu_noise=noise)


def scaled_focal_length(calibration: Calibration, factor: float) -> Calibration:
    """The focal length is off by a factor."""
    camera = calibration.camera
    camera = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)
    return replace(calibration, camera=camera)


# --------------------------------------------------------------------------------------------------


def _stamp(measurement: Measurement) -> int:
    return measurement.stop if isinstance(measurement, Gap) else measurement.stamp


def _timed(measurements: Iterable[Measurement]) -> Iterator[tuple[float, Measurement]]:
    first: int | None = None
    for m in measurements:
        first = _stamp(m) if first is None else first
        yield (_stamp(m) - first) / _NS, m
