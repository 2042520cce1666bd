# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images of any kind made grey, 8 bit.

Of 16-bit images the high byte is kept; colours are weighted as by BT.601 (OpenCV's `BGR2GRAY`).
"""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.measurements import Frame
from ruledgraph.recording.container import MAX_BLOCK, RawMessage, Topic
from ruledgraph.recording.errors import RecordingError
from ruledgraph.recording.messages import UnreadableMessageError, deserialise

Grey = NDArray[np.uint8]
_Pixels = NDArray[Any]

_MAX_PIXELS = 2**25
# Bits of a pixel that sensors have, in images of 16 bits.
_DEPTHS = (8, 10, 12, 14, 16)
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"


def _same(pixels: _Pixels) -> _Pixels:
    return pixels


def _with(code: int) -> Callable[[_Pixels], _Pixels]:
    return lambda pixels: cv2.cvtColor(pixels, code)


# Encoding -> channels, bits, conversion. ROS names a Bayer pattern by its first two pixels of the
# first row, OpenCV by the second row's second and third.
_ENCODINGS: dict[str, tuple[int, int, Callable[[_Pixels], _Pixels]]] = {
    "mono8": (1, 8, _same),
    "8UC1": (1, 8, _same),
    "mono16": (1, 16, _same),
    "16UC1": (1, 16, _same),
    "rgb8": (3, 8, _with(cv2.COLOR_RGB2GRAY)),
    "bgr8": (3, 8, _with(cv2.COLOR_BGR2GRAY)),
    "8UC3": (3, 8, _with(cv2.COLOR_BGR2GRAY)),
    "rgba8": (4, 8, _with(cv2.COLOR_RGBA2GRAY)),
    "bgra8": (4, 8, _with(cv2.COLOR_BGRA2GRAY)),
    "bayer_rggb8": (1, 8, _with(cv2.COLOR_BayerBG2GRAY)),
    "bayer_bggr8": (1, 8, _with(cv2.COLOR_BayerRG2GRAY)),
    "bayer_gbrg8": (1, 8, _with(cv2.COLOR_BayerGR2GRAY)),
    "bayer_grbg8": (1, 8, _with(cv2.COLOR_BayerGB2GRAY)),
    "bayer_rggb16": (1, 16, _with(cv2.COLOR_BayerBG2GRAY)),
    "bayer_bggr16": (1, 16, _with(cv2.COLOR_BayerRG2GRAY)),
    "bayer_gbrg16": (1, 16, _with(cv2.COLOR_BayerGR2GRAY)),
    "bayer_grbg16": (1, 16, _with(cv2.COLOR_BayerGB2GRAY)),
    # Brightness is every second byte.
    "yuv422": (2, 8, lambda pixels: pixels[..., 1]),
    "uyvy": (2, 8, lambda pixels: pixels[..., 1]),
    "yuv422_yuy2": (2, 8, lambda pixels: pixels[..., 0]),
    "yuyv": (2, 8, lambda pixels: pixels[..., 0]),
}
_IGNORING_CASE = {name.lower(): entry for name, entry in _ENCODINGS.items()}


def decode_image(topic: Topic, message: RawMessage) -> Grey:
    """The image of a message, (height, width).

    Raises:
        UnreadableMessageError: when it is damaged, or its encoding is not supported.
    """
    if isinstance(message.data, Path):
        return decode_file(read_image_file(message.data))
    image = deserialise(topic, message.data)
    if topic.type == "sensor_msgs/msg/CompressedImage":
        return decode_file(image.data.tobytes())
    return _decode_raw(image)


def check_image(topic: Topic, message: RawMessage) -> None:
    """See whether a PNG or JPEG is there and whole, without decoding it; others are not looked at.

    Raises:
        UnreadableMessageError: when it is missing or damaged.
    """
    if isinstance(message.data, Path):
        data = read_image_file(message.data)
    elif topic.type == "sensor_msgs/msg/CompressedImage":
        data = deserialise(topic, message.data).data.tobytes()
    else:
        return
    _check_file(data)


def encoded_image(topic: Topic, message: RawMessage) -> bytes | None:
    """The PNG or JPEG in a message that can be decoded; None for any other image."""
    if isinstance(message.data, Path):
        data = read_image_file(message.data)
    elif topic.type == "sensor_msgs/msg/CompressedImage":
        data = deserialise(topic, message.data).data.tobytes()
    else:
        return None
    return data if image_suffix(data) else None


def image_suffix(data: bytes) -> str:
    """`png` or `jpg`, by how a file begins; empty for another one."""
    return "png" if data.startswith(_PNG) else "jpg" if data.startswith(_JPEG) else ""


def read_image_file(path: Path) -> bytes:
    """The contents of an image file.

    Raises:
        UnreadableMessageError: when there is none.
    """
    try:
        if not path.is_file():  # nor a device or a pipe, which may never end
            raise UnreadableMessageError("its image file is missing")
        if path.stat().st_size > MAX_BLOCK:
            raise UnreadableMessageError("an image file is too large")
        return path.read_bytes()
    except (OSError, ValueError):
        raise UnreadableMessageError("its image file is missing") from None


def check_frame_size(frame: Frame, camera: CameraModel) -> None:
    """Compare a frame with the camera it should come from.

    Raises:
        RecordingError: when their sizes differ.
    """
    height, width = frame.image.shape
    if (width, height) != (camera.width, camera.height):
        raise RecordingError(
            f"frames are {width}x{height}, but the calibration is for "
            f"{camera.width}x{camera.height}: use the calibration of this camera and resolution"
        )


def _decode_raw(image: Any) -> Grey:
    entry = _IGNORING_CASE.get(image.encoding.strip().lower())
    if entry is None:
        raise UnreadableMessageError(
            f"unknown image encoding {image.encoding[:40]!r}; supported are {', '.join(_ENCODINGS)}"
        )
    channels, bits, convert = entry
    row = image.width * channels * bits // 8
    if not row or not image.height or image.step < row:
        raise UnreadableMessageError("its size makes no sense")
    # The padding of the last row may be missing.
    if image.step * (image.height - 1) + row > len(image.data):
        raise UnreadableMessageError("it is smaller than it says")
    rows = np.lib.stride_tricks.as_strided(
        image.data, (image.height, row), (image.step, 1), writeable=False
    )
    pixels = np.ascontiguousarray(rows)
    if bits == 16:
        pixels = _of_8_bits(pixels.view(">u2" if image.is_bigendian else "<u2"))
    if channels > 1:
        pixels = pixels.reshape(image.height, image.width, channels)
    try:
        grey = convert(np.ascontiguousarray(pixels))
    except cv2.error:
        raise UnreadableMessageError("it is too small for its encoding") from None
    return np.ascontiguousarray(grey, dtype=np.uint8)


def _of_8_bits(pixels: _Pixels) -> Grey:
    """The upper 8 bits of those that a camera of 10, 12 or 14 bits uses of 16."""
    brightest = int(pixels.max(initial=0))
    used = next(bits for bits in _DEPTHS if brightest < 2**bits)
    return (pixels >> (used - 8)).astype(np.uint8)


def decode_file(data: bytes) -> Grey:
    """A PNG or JPEG file as a grey image.

    PNG files are checked by their checksums, JPEG files, which have none, for their end.

    Raises:
        UnreadableMessageError: when it is damaged, or of another format.
    """
    width, height = _check_file(data)
    flags = cv2.IMREAD_UNCHANGED if data.startswith(_PNG) else cv2.IMREAD_GRAYSCALE
    try:
        pixels: _Pixels | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.shape[:2] != (height, width):
        raise UnreadableMessageError("a compressed image cannot be decoded")
    if pixels.dtype == np.uint16:
        pixels = _of_8_bits(pixels)
    if pixels.ndim == 3:
        code = cv2.COLOR_BGRA2GRAY if pixels.shape[2] == 4 else cv2.COLOR_BGR2GRAY
        pixels = cv2.cvtColor(pixels, code)
    return np.ascontiguousarray(pixels, dtype=np.uint8)


def _check_file(data: bytes) -> tuple[int, int]:
    """Width and height of a PNG or JPEG file that is whole, px."""
    if data.startswith(_PNG):
        width, height = _check_png(data)
    elif data.startswith(_JPEG):
        width, height = _check_jpeg(data)
    else:
        raise UnreadableMessageError("a compressed image is neither JPEG nor PNG, or is damaged")
    if not 0 < width * height <= _MAX_PIXELS:
        raise UnreadableMessageError(f"a size of {width}x{height} is not plausible")
    return width, height


def _check_png(data: bytes) -> tuple[int, int]:
    """Width and height of a PNG file all of whose checksums are right."""
    position = len(_PNG)
    size = None
    while position + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, position)
        end = position + 8 + length
        if end + 4 > len(data):
            break
        name = data[position + 4 : position + 8]
        if zlib.crc32(data[position + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            raise UnreadableMessageError("a PNG image has a wrong checksum")
        if name == b"IHDR" and length >= 8:
            size = struct.unpack_from(">II", data, position + 8)
        if name == b"IEND" and size:
            return size[0], size[1]
        position = end + 4
    raise UnreadableMessageError("a PNG image is cut")


def _check_jpeg(data: bytes) -> tuple[int, int]:
    """Width and height of a JPEG file that has a beginning and an end."""
    position = 2
    size = None
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker, length = (
            data[position + 1],
            int.from_bytes(data[position + 2 : position + 4], "big"),
        )
        if marker == 0xFF:  # fill byte
            position += 1
            continue
        # Start of frame, of any process: height and width follow the precision.
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[position + 5 : position + 9].ljust(4, b"\0"))
            size = width, height
        if marker == 0xDA and size:  # start of scan; from here on 0xFFD9 is the end alone
            if data.find(b"\xff\xd9", position) < 0:
                raise UnreadableMessageError("a JPEG image is cut")
            return size
        position += 2 + length
    raise UnreadableMessageError("a JPEG image has a damaged header")
