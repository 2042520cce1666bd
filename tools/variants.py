# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings as other cameras, lenses, mountings and IMUs would have made them."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import cv2
import gtsam
import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.recording.images import Grey

Rng: TypeAlias = np.random.Generator
# Of a quarter turn of the image counter-clockwise: new camera axes in the old ones.
_QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
# How an IMU may be turned on the body, rad about its axes.
_TURN = 1.3, -0.7, 2.1
# Of gyroscope (rad/s) and accelerometer (m/s^2).
_BIASES = np.array([0.06, -0.05, 0.04]), np.array([0.4, -0.3, 0.3])


def _same_image(image: Grey, _rng: Rng, _index: int) -> Grey:
    return image


def _same_sample(sample: ImuSample, _rng: Rng, _index: int) -> ImuSample | None:
    return sample


def _same_calibration(calibration: Calibration) -> Calibration:
    return calibration


@dataclass(frozen=True)
class Variant:
    """What is changed in a recording; by default nothing."""

    image: Callable[[Grey, Rng, int], Grey] = _same_image
    """Of an image and its index."""
    sample: Callable[[ImuSample, Rng, int], ImuSample | None] = _same_sample
    """Of an IMU sample and its index; None: it is left out."""
    calibration: Callable[[Calibration], Calibration] = _same_calibration
    stamp_sigma: float = 0.0
    """Standard deviation of the error of the frames' stamps, s."""

    def changed(self, measurements: Iterable[Measurement], rng: Rng) -> Iterator[Measurement]:
        """The recording with it."""
        frames = samples = 0
        for measurement in measurements:
            if isinstance(measurement, Frame):
                image = np.ascontiguousarray(self.image(measurement.image, rng, frames))
                late = round(1e9 * float(rng.normal(0.0, self.stamp_sigma)))
                frames += 1
                yield Frame(measurement.stamp + late, image)
            elif isinstance(measurement, ImuSample):
                samples += 1
                if (sample := self.sample(measurement, rng, samples)) is not None:
                    yield sample
            else:
                yield measurement


def turned_camera(calibration: Calibration, quarters: int) -> Calibration:
    """Of images that are turned counter-clockwise, as `numpy.rot90` does, by so many quarters."""
    for _ in range(quarters):
        camera, k = calibration.camera, list(calibration.camera.coefficients)
        if camera.distortion == "radtan":  # tangential distortion turns, too
            k[2:4] = -k[3], k[2]
        camera = replace(
            camera,
            width=camera.height,
            height=camera.width,
            fx=camera.fy,
            fy=camera.fx,
            cx=camera.cy,
            cy=camera.width - 1 - camera.cx,
            coefficients=tuple(k),
        )
        turn = gtsam.Pose3(gtsam.Rot3(_QUARTER.T), np.zeros(3))
        body_T_cam = calibration.body_T_cam.compose(turn)
        calibration = replace(calibration, camera=camera, body_T_cam=body_T_cam)
    return calibration


def resized_camera(calibration: Calibration, factor: float) -> Calibration:
    """Of images that are `factor` times as large."""
    camera, middle = calibration.camera, 0.5 * (factor - 1.0)
    resized = replace(
        camera,
        width=int(camera.width * factor),
        height=int(camera.height * factor),
        fx=camera.fx * factor,
        fy=camera.fy * factor,
        cx=camera.cx * factor + middle,
        cy=camera.cy * factor + middle,
    )
    return replace(calibration, camera=resized)


def turned_imu(calibration: Calibration) -> Calibration:
    """Of an IMU that is turned on the body by `_TURN`."""
    turn = gtsam.Pose3(gtsam.Rot3.RzRyRx(*_TURN), np.zeros(3))
    return replace(calibration, body_T_cam=turn.compose(calibration.body_T_cam))


def _resized(factor: float) -> Variant:
    filtering = cv2.INTER_CUBIC if factor > 1.0 else cv2.INTER_AREA

    def image(pixels: Grey, _rng: Rng, _index: int) -> Grey:
        size = int(pixels.shape[1] * factor), int(pixels.shape[0] * factor)
        return np.asarray(cv2.resize(pixels, size, interpolation=filtering), dtype=np.uint8)

    return Variant(image, calibration=partial(resized_camera, factor=factor))


def _turned(quarters: int) -> Variant:
    return Variant(
        lambda image, _rng, _index: np.rot90(image, quarters),
        calibration=partial(turned_camera, quarters=quarters),
    )


def _light(change: Callable[[FloatArray, Rng, int], FloatArray]) -> Variant:
    """Of the grey levels of every image."""

    def image(pixels: Grey, rng: Rng, index: int) -> Grey:
        changed = change(pixels.astype(np.float64), rng, index)
        return np.asarray(np.clip(np.round(changed), 0.0, 255.0), dtype=np.uint8)

    return Variant(image)


def _blurred(pixels: Grey, _rng: Rng, _index: int) -> Grey:
    return np.asarray(cv2.GaussianBlur(pixels, (0, 0), 2.0), dtype=np.uint8)


def _compressed(pixels: Grey, _rng: Rng, _index: int) -> Grey:
    encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 15])[1]
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def _imu(change: Callable[[FloatArray, FloatArray, Rng], tuple[FloatArray, FloatArray]]) -> Variant:
    """Of the readings of gyroscope and accelerometer."""
    return Variant(
        sample=lambda sample, rng, _index: ImuSample(sample.stamp, *change(*sample[1:], rng))
    )


def _imu_turned() -> Variant:
    R = gtsam.Rot3.RzRyRx(*_TURN).matrix()
    return replace(_imu(lambda w, f, _rng: (R @ w, R @ f)), calibration=turned_imu)


def _imu_rate(divisor: int) -> Variant:
    return Variant(sample=lambda sample, _rng, index: None if index % divisor else sample)


GLOBAL_SHUTTER_ONLY = ("turned by 90 deg", "turned by 180 deg")
"""The rows of a rolling shutter would be read in another order."""

VARIANTS: dict[str, Variant] = {
    "as recorded": Variant(),
    "every 2nd IMU sample": _imu_rate(2),
    "every 4th IMU sample": _imu_rate(4),
    "turned by 90 deg": _turned(1),
    "turned by 180 deg": _turned(2),
    "1.5 times the size": _resized(1.5),
    "2/3 of the size": _resized(2.0 / 3.0),
    "IMU turned on the body": _imu_turned(),
    "contrast of 35 %": _light(lambda g, _rng, _index: 0.35 * g + 80.0),
    "a quarter of the light": _light(lambda g, _rng, _index: 0.25 * g),
    "gamma of 0.5": _light(lambda g, _rng, _index: 255.0 * (g / 255.0) ** 0.5),
    "gamma of 2": _light(lambda g, _rng, _index: 255.0 * (g / 255.0) ** 2),
    "noise of 8 grey levels": _light(lambda g, rng, _index: g + rng.normal(0.0, 8.0, g.shape)),
    "noise of 15 grey levels": _light(lambda g, rng, _index: g + rng.normal(0.0, 15.0, g.shape)),
    "exposure swings by 60 %": _light(lambda g, _rng, i: g * (1.0 + 0.6 * np.sin(0.1 * i))),
    "blurred by 2 px": Variant(_blurred),
    "JPEG of quality 15": Variant(_compressed),
    "biases of 0.58 m/s^2, 0.09 rad/s": _imu(lambda w, f, _rng: (w + _BIASES[0], f + _BIASES[1])),
    "gyroscope's scale off by 1 %": _imu(lambda w, f, _rng: (1.01 * w, f)),
    "accelerometer's scale off by 3 %": _imu(lambda w, f, _rng: (w, 1.03 * f)),
    "stamps scatter by 2 ms": Variant(stamp_sigma=0.002),
    "stamps scatter by 5 ms": Variant(stamp_sigma=0.005),
}
