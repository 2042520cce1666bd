# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What goes wrong with the images of a camera, or comes between it and the scene."""

from collections.abc import Callable, Iterable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from faults import Fault, timed
from ruledgraph.core.measurements import Frame, Measurement

Image = NDArray[np.uint8]
Change = Callable[[Image, float], Image]
"""Of an image at a time, s after the first measurement."""

_NS = 1e9


def of_images(change: Change, start: float, length: float) -> Fault:
    """Change the images from `start` for `length`; `change` is given the time."""

    def apply(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        for time, m in timed(measurements):
            if isinstance(m, Frame) and start <= time < start + length:
                yield Frame(m.stamp, change(m.image, time))
            else:
                yield m

    return apply


def exposure_jumps(gains: tuple[float, ...], every: float) -> Change:
    """The brightness jumps from one gain to the next, `every` so many seconds."""

    def change(image: Image, time: float) -> Image:
        return np.asarray(
            cv2.convertScaleAbs(image, alpha=gains[int(time / every) % len(gains)]), np.uint8
        )

    return change


def blurred(pixels: int) -> Change:
    """As by a long exposure: smeared so far, in a direction that turns."""

    def change(image: Image, time: float) -> Image:
        kernel = np.zeros((pixels, pixels), np.float32)
        half = 0.5 * (pixels - 1)
        reach = half * np.array([np.cos(3.0 * time), np.sin(3.0 * time)])
        ends = [np.round(half + sign * reach).astype(int).tolist() for sign in (-1.0, 1.0)]
        cv2.line(kernel, ends[0], ends[1], 1.0)
        return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.uint8)

    return change


def covered(grey: int = 0, noise: float = 1.0) -> Change:
    """A hand before the lens, or a blank wall: one grey and the sensor's noise."""

    def change(image: Image, time: float) -> Image:
        rng = np.random.default_rng(round(time * _NS))
        return np.clip(grey + noise * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)

    return change


def overlay(level: int = 235, seed: int = 0) -> Change:
    """What is burnt into all images alike, as by a head-up display: a frame, a cross hair, and
    straight strokes drawn from the seed.
    """

    def change(image: Image, _time: float) -> Image:
        rows, columns = image.shape
        size = np.array([columns, rows])
        rng = np.random.default_rng([seed, 6])
        changed = image.copy()
        inset = (0.06 * size).astype(int)
        cv2.rectangle(changed, inset.tolist(), (size - inset).tolist(), level, 2)
        middle, arm = size // 2, (0.08 * size).astype(int)
        for axis in np.eye(2, dtype=int):
            cv2.line(
                changed, (middle - axis * arm).tolist(), (middle + axis * arm).tolist(), level, 2
            )
        for ends in rng.uniform(0.1, 0.9, size=(6, 2, 2)):
            first, second = (ends * size).astype(int).tolist()
            cv2.line(changed, first, second, level, 2)
        return changed

    return change


def textured_rectangle(
    width: float = 0.6, height: float = 0.6, speed: float = 0.03, seed: int = 0
) -> Change:
    """A poster of random fields, so large a share of the image, drifts slowly across the scene.

    Its edges are straight and move by `speed` image widths a second, to and fro.
    """

    def change(image: Image, time: float) -> Image:
        rows, columns = image.shape
        rng = np.random.default_rng([seed, 7])
        shape = round(height * rows), round(width * columns)
        fields = rng.integers(20, 236, size=(6, 8)).astype(np.float32)
        poster = cv2.resize(fields, shape[::-1], interpolation=cv2.INTER_NEAREST)
        u = (time * speed / (1.0 - width)) % 2.0
        shift = np.array(
            [
                [1.0, 0.0, (1.0 - width) * columns * (u if u < 1.0 else 2.0 - u)],
                [0.0, 1.0, 0.5 * (1.0 - height) * rows],
            ]
        )
        size = columns, rows
        cover = cv2.warpAffine(np.ones_like(poster), shift, size)
        there = cv2.warpAffine(poster, shift, size)
        return np.clip(image * (1.0 - cover) + there, 0, 255).astype(np.uint8)

    return change


def moving_object(width: float = 1 / 3, speed: float = 0.15) -> Change:
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
