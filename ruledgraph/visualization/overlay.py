# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's image with the rulings found in it, their numbers, and a strip with the status."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.figure_style import Color, line_color, rgb, status_color
from ruledgraph.visualization.views import View, ViewedLine

Image = NDArray[np.uint8]

_YELLOW: Color = (255, 214, 10)
"""Of lines that are tracked but not in the graph yet."""
# An image narrower than this is drawn twice as large, px: thin lines and numbers stay sharp.
_NARROW = 800
# Grey levels are stretched to these, for all but the darkest and brightest hundredth: images come
# out alike, and dark enough for colours to stand out.
_DARKEST, _BRIGHTEST = 12.0, 170.0
_STRIP = 30
_STRIP_COLOR: Color = (24, 30, 40)
_FONT, _NUMBER_SIZE = cv2.FONT_HERSHEY_DUPLEX, 0.55
# cv2 takes coordinates with this many fractional bits.
_BITS = 3


def overlay_scale(camera: CameraModel) -> int:
    """How many times larger than the image an overlay is drawn."""
    return 2 if camera.width < _NARROW else 1


def overlay_size(camera: CameraModel) -> tuple[int, int]:
    """Width and height of an overlay, px; both are even, as video formats want them."""
    scale = overlay_scale(camera)
    width, height = camera.width * scale, camera.height * scale + _STRIP
    return width + width % 2, height + height % 2


def draw_overlay(view: View, camera: CameraModel) -> Image:
    """The image of a frame with rulings, edge points, line numbers and the status, BGR."""
    scale = overlay_scale(camera)
    width, height = overlay_size(camera)
    canvas = np.full((height, width, 3), _STRIP_COLOR[::-1], np.uint8)
    grey = cv2.resize(_toned(view.frame.image), None, fx=scale, fy=scale)
    canvas[: grey.shape[0], : grey.shape[1]] = grey[:, :, None]
    image: Any = canvas[: grey.shape[0]]
    for line in view.lines:
        _draw_line(image, line, camera, scale)
    for line in view.lines:
        _draw_number(image, line, camera, scale)
    _draw_strip(canvas, view)
    return canvas


def _toned(image: Image) -> Image:
    low, high = np.percentile(image[::4, ::4], (1.0, 99.0))
    gain = (_BRIGHTEST - _DARKEST) / max(float(high - low), 32.0)
    table = np.clip(_DARKEST + gain * (np.arange(256) - low), 0.0, 255.0)
    return np.asarray(cv2.LUT(image, table.astype(np.uint8)), dtype=np.uint8)


def _draw_line(image: Any, line: ViewedLine, camera: CameraModel, scale: int) -> None:
    color = _color(line)
    curve = _fixed_point(line.curve(camera), scale)
    for drawn, thickness in (((0, 0, 0), 2 * scale + 2), (color, scale + 1)):
        cv2.polylines(image, [curve], False, drawn, thickness, cv2.LINE_AA, _BITS)
    radius = round(1.6 * scale * (1 << _BITS))
    for u, v in _fixed_point(line.pixels(camera), scale).tolist():
        cv2.circle(image, (u, v), radius, color, -1, cv2.LINE_AA, _BITS)


def _draw_number(image: Any, line: ViewedLine, camera: CameraModel, scale: int) -> None:
    """Beside the middle of a line that is in the graph."""
    if not line.in_graph:
        return
    curve = line.curve(camera) * scale
    middle, along = curve[len(curve) // 2], curve[-1] - curve[0]
    across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    across = across if across[1] < 0.0 else -across
    text = str(line.id)
    (width, height), _ = cv2.getTextSize(text, _FONT, _NUMBER_SIZE, 1)
    u, v = middle + 14.0 * across
    corner = round(u - 0.5 * width), round(v + 0.5 * height)
    light = tuple((2 * part + 255) // 3 for part in _color(line))
    for color, thickness in (((0, 0, 0), 4), (light, 1)):
        cv2.putText(image, text, corner, _FONT, _NUMBER_SIZE, color, thickness, cv2.LINE_AA)


def _draw_strip(canvas: Any, view: View) -> None:
    """Time, status, and how many lines there are, below the image."""
    middle = canvas.shape[0] - _STRIP // 2
    color = rgb(status_color(view.status))[::-1]
    cv2.rectangle(canvas, (12, middle - 6), (24, middle + 6), color, -1)
    in_graph = sum(line.in_graph for line in view.lines)
    text = f"{view.status}   {in_graph} lines"
    if waiting := len(view.lines) - in_graph:
        text += f" + {waiting} new"
    base = middle + 6
    white = (235, 238, 243)
    cv2.putText(canvas, text, (34, base), _FONT, 0.5, white, 1, cv2.LINE_AA)
    time = f"{view.since_start:.2f} s"
    (width, _), _ = cv2.getTextSize(time, _FONT, 0.5, 1)
    corner = (canvas.shape[1] - width - 12, base)
    cv2.putText(canvas, time, corner, _FONT, 0.5, white, 1, cv2.LINE_AA)


def _color(line: ViewedLine) -> Color:
    """Blue, green, red."""
    red, green, blue = line_color(line.id) if line.in_graph else _YELLOW
    return blue, green, red


def _fixed_point(pixels: FloatArray, scale: int) -> NDArray[np.int32]:
    """Where pixels, whose centres are whole numbers, lie in the larger image."""
    larger = (pixels + 0.5) * scale - 0.5
    return np.rint(larger * (1 << _BITS)).astype(np.int32)
