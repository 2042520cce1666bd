# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whole recordings of messages with any numbers in their fields: used, or left out and counted."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from recordings import MS, T0, Entry, imu, png, raw_image, texture, write_bag
from ruledgraph.core.measurements import Frame, Gap, ImuSample
from ruledgraph.diagnostics.info import inspect_recording
from ruledgraph.recording import RecordingError, open_recording
from ruledgraph.recording.images import _ENCODINGS

NUMBERS = st.one_of(
    st.floats(width=64), st.sampled_from([0.0, 9.81, 1e6, -1e300, float("nan"), float("inf")])
)
SIZES = st.one_of(st.integers(0, 20), st.sampled_from([2**16, 2**31 - 1, 2**31, 2**32 - 1]))
STAMPS = st.one_of(
    st.integers(0, 2000).map(lambda ms: T0 + ms * MS),
    st.sampled_from([0, 1, 999, T0 - 1, T0 + 10**12, (2**31 - 1) * 10**9 + 999_999_999]),
)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
ENCODINGS = st.one_of(st.sampled_from([*_ENCODINGS, "MONO8 ", ""]), st.text(max_size=8))


@st.composite
def messages(draw: st.DrawFn) -> Entry:
    stamp = draw(STAMPS)
    if draw(st.booleans()):
        return imu(stamp, draw(VECTORS), draw(VECTORS))
    if draw(st.booleans()):
        size, step = (draw(SIZES), draw(SIZES)), draw(SIZES)
        data = draw(st.one_of(st.binary(max_size=64), st.just(b"\7" * 400)))
        return raw_image(stamp, draw(ENCODINGS), *size, step, data, draw(st.booleans()))
    return raw_image(stamp, "mono8", 16, 12, 16, texture(stamp % 7).tobytes())


@pytest.mark.parametrize("bag", ["rosbag1", "mcap"])
def test_any_numbers_in_messages(bag: str, tmp_path: Path) -> None:
    outcomes = {"read": 0, "refused": 0}

    @settings(
        max_examples=40,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.lists(messages(), min_size=1, max_size=25), st.integers(0, 10**9))
    def attempt(entries: list[Entry], number: int) -> None:
        good = [imu(T0 + i * 10 * MS) for i in range(100)]
        path = tmp_path / f"{number}-{sum(outcomes.values())}"
        write_bag(path, bag, sorted([*good, *entries], key=lambda e: e.stamp))
        last = {Frame: -1, ImuSample: -1}
        inspect_recording(path).as_dict()
        try:
            for m in open_recording(path).stream():
                if isinstance(m, Gap):
                    continue
                assert m.stamp > last[type(m)]
                last[type(m)] = m.stamp
                if isinstance(m, ImuSample):
                    assert np.isfinite(m.gyroscope).all()
                    assert np.isfinite(m.accelerometer).all()
                else:
                    assert m.image.dtype == np.uint8
                    assert m.image.ndim == 2
            outcomes["read"] += 1
        except RecordingError as error:
            assert "\n" not in str(error)  # noqa: PT017 - both ends are fine
            outcomes["refused"] += 1

    attempt()
    assert min(outcomes.values()) > 3


def test_compressed_images_of_any_bytes() -> None:
    from ruledgraph.recording.images import decode_file
    from ruledgraph.recording.messages import UnreadableMessageError

    good = png(texture(1))

    @settings(max_examples=200, deadline=None, derandomize=True, database=None)
    @given(st.integers(0, len(good) - 1), st.binary(max_size=40), st.booleans())
    def attempt(at: int, data: bytes, jpeg: bool) -> None:
        start = b"\xff\xd8\xff" if jpeg else good[:at]
        try:
            image = decode_file(start + data)
        except UnreadableMessageError:
            return
        assert image.ndim == 2

    attempt()
