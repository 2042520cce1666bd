# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""From the light that falls on the sensor to the image that comes out of the camera."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import RuledgraphError

Image = NDArray[np.float32]


@dataclass(frozen=True)
class ImageQuality:
    """Blur, noise, uneven and changing brightness, and lost frames.

    Raises:
        RuledgraphError: for figures out of their range.
    """

    exposure: float = 0.005
    """s; a moving image is blurred over it. Stamps are of its middle."""
    lens_blur: float = 0.5
    """Deviation of the lens's point spread, px."""
    gain: float = 1.1
    """Of the image by the brightness of the scene."""
    photon_noise: float = 0.03
    """Variance of a pixel by its value, both in grey levels."""
    read_noise: float = 1.2
    """Deviation of a pixel in the dark, grey levels."""
    vignetting: float = 0.25
    """Share of the light that is lost in the corners."""
    gain_drift: float = 0.05
    """Size of slow changes of the gain, relative."""
    gain_step: float = 0.0
    """Size of sudden changes of the gain, one every few seconds, relative."""
    dropped: float = 0.0
    """Share of the frames that is lost."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0.0):
                raise RuledgraphError(f"image quality: {name} = {value} is negative or not finite")
        if self.dropped >= 1.0 or self.vignetting >= 1.0:
            raise RuledgraphError("image quality: dropped and vignetting must be below 1")


PERFECT = ImageQuality(
    exposure=0.0,
    lens_blur=0.0,
    photon_noise=0.0,
    read_noise=0.0,
    vignetting=0.0,
    gain_drift=0.0,
)
"""No blur, no noise, constant and even brightness."""

# Seconds between sudden changes of the gain, and those of the slow ones' two waves.
_STEP_EVERY = 3.0
_DRIFT_PERIODS = np.array([7.3, 17.9])


class Sensor:
    """Turns brightness into grey levels; the same frame always in the same way.

    Args:
        camera: whose images.
        quality: how good they are.
        seed: of all randomness.
    """

    def __init__(self, camera: CameraModel, quality: ImageQuality, seed: int) -> None:
        self._quality, self._seed = quality, seed
        u = (np.arange(camera.width, dtype=np.float32) + 0.5) / camera.width * 2.0 - 1.0
        v = (np.arange(camera.height, dtype=np.float32) + 0.5) / camera.height * 2.0 - 1.0
        lost = quality.vignetting * (0.5 * (u[None, :] ** 2 + v[:, None] ** 2)) ** 1.5
        self._transmission = (1.0 - lost).astype(np.float32)

    def drops(self, frame: int) -> bool:
        """Whether the frame of that number is lost."""
        return bool(np.random.default_rng([self._seed, 3, frame]).random() < self._quality.dropped)

    def develop(self, brightness: Image, frame: int, time: float) -> NDArray[np.uint8]:
        """The image, (height, width), of the mean brightness over the exposure, 0 to 255.

        Args:
            brightness: (height, width).
            frame: its number, which decides its noise.
            time: s, which decides its gain.
        """
        quality = self._quality
        if quality.lens_blur:
            brightness = np.asarray(cv2.GaussianBlur(brightness, (0, 0), quality.lens_blur))
        image = brightness * (self._transmission * np.float32(quality.gain * self._gain(time)))
        if quality.photon_noise or quality.read_noise:
            rng = np.random.Generator(np.random.SFC64([self._seed, 4, frame]))
            noise = rng.standard_normal(image.shape, dtype=np.float32)
            variance = np.float32(quality.photon_noise) * image + np.float32(quality.read_noise**2)
            image += noise * np.sqrt(variance, out=variance)
        image += np.float32(0.5)
        return np.clip(image, 0.0, 255.0, out=image).astype(np.uint8)

    def _gain(self, time: float) -> float:
        rng = np.random.default_rng([self._seed, 5])
        waves = np.sin(2.0 * np.pi * (time / _DRIFT_PERIODS + rng.random(2)))
        step = np.random.default_rng([self._seed, 6, int(time / _STEP_EVERY)]).uniform(-1.0, 1.0)
        return float(1.0 + self._quality.gain_drift * waves.mean() + self._quality.gain_step * step)
