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

import gtsam
import numpy as np

from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement

Fault = Callable[[Iterable[Measurement]], Iterator[Measurement]]

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
        for time, m in timed(measurements):
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
        for time, m in timed(measurements):
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
    """A frozen sensor: its last image or reading again and again, with new stamps."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        last: Frame | ImuSample | None = None
        for time, m in timed(measurements):
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


def bias_step(
    start: float, accelerometer: float = 0.0, gyroscope_ramp: float = 0.0, seed: int = 0
) -> Fault:
    """Biases change from `start` on, along a direction of the body drawn from the seed.

    The accelerometer's jumps, m/s^2; the gyroscope's grows, rad/s^2.
    """

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        direction = np.random.default_rng([seed, 5]).normal(size=3)
        direction /= np.linalg.norm(direction)
        for time, m in timed(measurements):
            if isinstance(m, ImuSample) and time >= start:
                rate = m.gyroscope + gyroscope_ramp * (time - start) * direction
                yield ImuSample(m.stamp, rate, m.accelerometer + accelerometer * direction)
            else:
                yield m

    return apply


def lift(start: float, acceleration: float, length: float) -> Fault:
    """Of a body that rests in a lift, from `start` for `length`: the IMU feels what the images do
    not show.

    The lift accelerates upwards by `acceleration` (m/s^2) for a quarter of the time, goes on, and
    slows down for the last quarter. Upwards is where the accelerometer points before.
    """

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        total = np.zeros(3)
        for time, m in timed(measurements):
            if not isinstance(m, ImuSample):
                yield m
                continue
            if time < start:
                total += m.accelerometer
            phase = (time - start) / length
            sign = float(0.0 <= phase < 0.25) - float(0.75 <= phase < 1.0)
            up = total / max(float(np.linalg.norm(total)), 1e-9)
            yield m._replace(accelerometer=m.accelerometer + sign * acceleration * up)

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


def other_camera(calibration: Calibration, other: Calibration) -> Calibration:
    """The figures of another camera of the rig."""
    return replace(calibration, camera=other.camera, body_T_cam=other.body_T_cam)


def scaled_noise(calibration: Calibration, factor: float) -> Calibration:
    """The IMU's noise figures are off by a factor."""
    noise = ImuNoise(*(factor * value for value in vars(calibration.imu_noise).values()))
    return replace(calibration, imu_noise=noise)


def scaled_focal_length(calibration: Calibration, factor: float) -> Calibration:
    """The focal length is off by a factor."""
    return replace(calibration, camera=calibration.camera.with_focal_ratio(factor))


# --------------------------------------------------------------------------------------------------


def _stamp(measurement: Measurement) -> int:
    return measurement.stop if isinstance(measurement, Gap) else measurement.stamp


def timed(measurements: Iterable[Measurement]) -> Iterator[tuple[float, Measurement]]:
    """Measurements with their times, s after the first."""
    first: int | None = None
    for m in measurements:
        first = _stamp(m) if first is None else first
        yield (_stamp(m) - first) / _NS, m
