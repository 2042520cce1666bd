# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images of every encoding, built from bytes, become the same grey."""

import contextlib
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recordings import T0, Entry, compressed_image, png, raw_image, serialise, texture
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.measurements import Frame
from ruledgraph.recording import RecordingError, check_frame_size
from ruledgraph.recording.container import RawMessage, Topic
from ruledgraph.recording.images import check_image, decode_file, decode_image
from ruledgraph.recording.messages import UnreadableMessageError

WIDTH, HEIGHT = 16, 12
GREY = texture(3)
COLOUR = texture(4, (HEIGHT, WIDTH, 3))  # blue, green, red
WEIGHTED = cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)
ALPHA = np.full((HEIGHT, WIDTH, 1), 77, np.uint8)
BAYER = {  # place of the colours in the 2x2 pattern, by index into blue, green, red
    "rggb": (2, 1, 1, 0),
    "bggr": (0, 1, 1, 2),
    "gbrg": (1, 0, 2, 1),
    "grbg": (1, 2, 0, 1),
}


def decode(entry: Entry, encoding: str) -> NDArray[np.uint8]:
    topic = Topic(entry.topic, entry.type, encoding, 1)
    return decode_image(topic, RawMessage(entry.stamp, entry.topic, serialise(encoding, entry)))


def padded(pixels: NDArray[Any], padding: int) -> tuple[int, bytes]:
    """Row length and bytes of an image whose rows are followed by rubbish."""
    rows = np.frombuffer(pixels.tobytes(), np.uint8).reshape(HEIGHT, -1)
    rubbish = np.full((HEIGHT, padding), 255, np.uint8)
    return rows.shape[1] + padding, np.hstack([rows, rubbish]).tobytes()


def yuv(first: int) -> NDArray[np.uint8]:
    pixels = texture(5, (HEIGHT, WIDTH, 2))
    pixels[..., first] = GREY
    return pixels


CASES = [
    ("mono8", GREY, GREY),
    ("8UC1", GREY, GREY),
    ("MONO8", GREY, GREY),
    ("bgr8", COLOUR, WEIGHTED),
    ("8UC3", COLOUR, WEIGHTED),
    ("rgb8", COLOUR[..., ::-1], WEIGHTED),
    ("bgra8", np.concatenate([COLOUR, ALPHA], axis=2), WEIGHTED),
    ("rgba8", np.concatenate([COLOUR[..., ::-1], ALPHA], axis=2), WEIGHTED),
    ("yuv422", yuv(1), GREY),
    ("uyvy", yuv(1), GREY),
    ("yuv422_yuy2", yuv(0), GREY),
    ("yuyv", yuv(0), GREY),
]


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("serialisation", ["ros1", "cdr"])
@pytest.mark.parametrize(("encoding", "pixels", "expected"), CASES)
def test_eight_bits(
    encoding: str,
    pixels: NDArray[np.uint8],
    expected: NDArray[np.uint8],
    serialisation: str,
    padding: int,
) -> None:
    step, data = padded(pixels, padding)
    entry = raw_image(T0, encoding, WIDTH, HEIGHT, step, data)
    np.testing.assert_array_equal(decode(entry, serialisation), expected)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", ["mono16", "16UC1"])
def test_the_high_byte_of_sixteen_bits(encoding: str, big_endian: bool) -> None:
    deep = GREY.astype(np.uint16) * 256 + texture(6)
    step, data = padded(deep.astype(">u2" if big_endian else "<u2"), 4)
    entry = raw_image(T0, encoding, WIDTH, HEIGHT, step, data, big_endian)
    np.testing.assert_array_equal(decode(entry, "cdr"), GREY)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("bits", [8, 10, 12, 14])
def test_the_bits_in_use_of_sixteen(bits: int, big_endian: bool) -> None:
    """Of a machine vision or thermal camera."""
    deep = (GREY.astype(np.uint16) << (bits - 8)) + texture(6) % 2 ** (bits - 8)
    deep[0, 0] = 2**bits - 1
    step, data = padded(deep.astype(">u2" if big_endian else "<u2"), 4)
    entry = raw_image(T0, "mono16", WIDTH, HEIGHT, step, data, big_endian)
    expected = GREY.copy()
    expected[0, 0] = 255
    np.testing.assert_array_equal(decode(entry, "cdr"), expected)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", BAYER)
def test_bayer_of_one_colour(pattern: str, bits: int) -> None:
    """A surface of one colour has its brightness everywhere, whatever the pattern."""
    colour = np.array([200, 90, 20], np.uint8)
    tile = colour[list(BAYER[pattern])].reshape(2, 2)
    mosaic = np.tile(tile, (HEIGHT // 2, WIDTH // 2))
    stored = mosaic if bits == 8 else mosaic.astype("<u2") * 256 + 17
    entry = raw_image(
        T0, f"bayer_{pattern}{bits}", WIDTH, HEIGHT, WIDTH * bits // 8, stored.tobytes()
    )
    grey = int(cv2.cvtColor(colour.reshape(1, 1, 3), cv2.COLOR_BGR2GRAY)[0, 0])
    inner = decode(entry, "ros1")[2:-2, 2:-2].astype(int)
    assert np.abs(inner - grey).max() <= 1


@pytest.mark.parametrize(
    ("pixels", "expected"),
    [
        (GREY, GREY),
        (GREY.astype(np.uint16) * 256 + 99, GREY),
        (COLOUR, WEIGHTED),
        (np.concatenate([COLOUR, ALPHA], axis=2), WEIGHTED),
    ],
)
def test_png(pixels: NDArray[Any], expected: NDArray[np.uint8]) -> None:
    entry = compressed_image(T0, png(pixels), "png")
    np.testing.assert_array_equal(decode(entry, "cdr"), expected)


def test_jpeg() -> None:
    smooth = cv2.resize(texture(1, (3, 4)), (64, 48), interpolation=cv2.INTER_CUBIC)
    for pixels in (smooth, cv2.cvtColor(smooth, cv2.COLOR_GRAY2BGR)):
        data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
        image = decode(compressed_image(T0, data), "ros1")
        assert image.dtype == np.uint8
        assert np.abs(image.astype(int) - smooth).max() <= 8


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        (raw_image(T0, "mono9", 16, 12, 16, GREY.tobytes()), "unknown image encoding 'mono9'"),
        (raw_image(T0, "mono8", 16, 12, 16, GREY.tobytes()[:-1]), "smaller than it says"),
        (raw_image(T0, "mono8", 2**31, 12, 2**31, GREY.tobytes()), "smaller than it says"),
        (raw_image(T0, "mono8", 16, 2**31, 16, GREY.tobytes()), "smaller than it says"),
        (raw_image(T0, "mono8", 16, 12, 15, GREY.tobytes()), "size makes no sense"),
        (raw_image(T0, "mono8", 0, 12, 16, GREY.tobytes()), "size makes no sense"),
        (raw_image(T0, "mono8", 16, 0, 16, GREY.tobytes()), "size makes no sense"),
        (compressed_image(T0, b""), "neither JPEG nor PNG"),
        (compressed_image(T0, b"RIFF....WEBP"), "neither JPEG nor PNG"),
    ],
)
def test_unusable_images(entry: Entry, text: str) -> None:
    with pytest.raises(UnreadableMessageError, match=text):
        decode(entry, "cdr")


def test_the_last_row_may_lack_its_padding() -> None:
    step, data = padded(GREY, 5)
    entry = raw_image(T0, "mono8", WIDTH, HEIGHT, step, data[:-5])
    np.testing.assert_array_equal(decode(entry, "cdr"), GREY)


def test_any_flipped_or_missing_byte_of_a_png_is_found() -> None:
    whole = png(GREY)
    rng = np.random.default_rng(0)
    for position in range(len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(8))
        for data in (bytes(damaged), whole[:position]):
            with pytest.raises(UnreadableMessageError):
                decode_file(data)


def test_damaged_jpegs_end_in_an_image_or_are_refused() -> None:
    """JPEG has no checksums: flipped bytes between its header and its end may pass."""
    whole = cv2.imencode(".jpg", GREY)[1].tobytes()
    rng = np.random.default_rng(0)
    for position in range(len(whole)):
        with pytest.raises(UnreadableMessageError):
            decode_file(whole[:position])
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(8))
        with contextlib.suppress(UnreadableMessageError):
            assert decode_file(bytes(damaged)).dtype == np.uint8


def test_frame_size_is_compared_with_the_calibration() -> None:
    frame = Frame(T0, GREY)
    check_frame_size(frame, CameraModel(16, 12, 10.0, 10.0, 8.0, 6.0))
    with pytest.raises(RecordingError, match="frames are 16x12, but the calibration is for 12x16"):
        check_frame_size(frame, CameraModel(12, 16, 10.0, 10.0, 8.0, 6.0))


def test_files_are_seen_to_be_whole_without_decoding_them():
    def check(entry: Entry) -> None:
        topic = Topic(entry.topic, entry.type, "cdr", 1)
        check_image(topic, RawMessage(entry.stamp, entry.topic, serialise("cdr", entry)))

    file = png(GREY)
    check(compressed_image(T0, file, "png"))
    with pytest.raises(UnreadableMessageError, match="PNG image is cut"):
        check(compressed_image(T0, file[:-20], "png"))
    # What is no file has nothing to show.
    check(raw_image(T0, "rubbish", 0, 0, 0, b"1"))
