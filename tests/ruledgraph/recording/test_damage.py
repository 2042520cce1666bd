# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Damaged recordings: cut at many places, bytes flipped at many places, in every format.

Every case must end in a `RecordingError` of one line or in measurements; never in another
exception, a hang or a huge allocation. What is delivered must be what was recorded, as far as the
format lets one know: MCAP chunks may and PNG files do carry checksums. Raw bags carry none, so
there a flipped pixel, digit or stamp cannot be told from a recorded one, and the test counts how
many measurements one flipped byte may change.
"""

import resource
import shutil
import struct
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from recordings import BAGS, assert_same, entries_of, fields, sequence, write_asl, write_bag
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.recording import RecordingError, Report, open_recording

MEASUREMENTS = sequence(1.5, shape=(24, 32))
CUTS = 30
FLIPS = 80
WITHOUT_LIMIT = ("rosbag1-lz4", "sqlite3-file", "mcap-file", "mcap-storage")
SECONDS = 5.0
MEGABYTES = 4000


@contextmanager
def limited_memory() -> Iterator[None]:
    """Allocations for absurd sizes fail instead of swapping."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEGABYTES * 2**20, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def read(path: Path) -> tuple[list[Measurement], Report | None, str]:
    """What the stream delivers, its report, and the error it ends with."""
    began = time.monotonic()
    found: list[Measurement] = []
    report, message = None, ""
    try:
        with limited_memory():
            recording = open_recording(path)
            for measurement in recording.stream():
                found.append(measurement)
                report = recording.report
    except RecordingError as error:
        message = str(error)
        assert message
        assert "\n" not in message
    assert time.monotonic() - began < SECONDS
    return found, report, message


def storage(path: Path) -> Path:
    """The file that holds the messages."""
    if path.is_file():
        return path
    (file,) = [file for file in path.iterdir() if file.name != "metadata.yaml"]
    return file


def originals(found: Sequence[Measurement]) -> tuple[int, int]:
    """How many of the measurements are as they were recorded, and how many are not."""
    expected = {(type(m), fields(m)[0]): m for m in MEASUREMENTS}
    same = 0
    found = [m for m in found if not isinstance(m, Gap)]
    for m in found:
        other = expected.get((type(m), fields(m)[0]))
        same += other is not None and all(
            np.array_equal(x, y) for x, y in zip(fields(m)[1:], fields(other)[1:], strict=True)
        )
    return same, len(found) - same


@pytest.mark.parametrize("bag", BAGS)
def test_cut_bags(bag: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", bag, entries_of(MEASUREMENTS))
    file = storage(path)
    data = file.read_bytes()
    recovered = []
    for cut in np.linspace(0, len(data) - 1, CUTS).astype(int).tolist():
        file.write_bytes(data[:cut])
        found, report, message = read(path)
        _, wrong = originals(found)
        assert wrong == 0
        recovered.append(sum(not isinstance(m, Gap) for m in found))
        if not message and recovered[-1] < len(MEASUREMENTS):
            assert report is not None
            assert report.warnings
    # The more there is, the more is read; of compressed chunks only whole ones.
    assert recovered == sorted(recovered)
    if bag in ("rosbag1", "mcap", "mcap-message", "sqlite3"):
        assert recovered[CUTS // 2] > 0.2 * len(MEASUREMENTS)
        assert recovered[-1] > 0.9 * len(MEASUREMENTS)


@pytest.mark.parametrize("bag", BAGS)
def test_flipped_bytes_in_bags(bag: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", bag, entries_of(MEASUREMENTS))
    file = storage(path)
    data = file.read_bytes()
    rng = np.random.default_rng(1)
    # Half of them where the format's own structure lies.
    positions = [*rng.integers(0, len(data), FLIPS // 2), *rng.integers(0, 4600, FLIPS // 2)]
    for position in positions:
        damaged = bytearray(data)
        damaged[position % len(data)] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        found, _, _ = read(path)
        _, wrong = originals(found)
        # Compressed data that follow may be copied from those that are wrong.
        assert wrong <= (len(MEASUREMENTS) if bag in WITHOUT_LIMIT else 1), position


def with_checksums(path: Path) -> None:
    """Give the chunks of an MCAP file the checksums that rosbags leaves out."""
    data = bytearray(path.read_bytes())
    position = 8
    while position < len(data) - 8:
        op, length = struct.unpack_from("<BQ", data, position)
        if op == 6:
            (name,) = struct.unpack_from("<I", data, position + 9 + 28)
            begin = position + 9 + 32 + name + 8
            crc = zlib.crc32(data[begin : position + 9 + length])
            struct.pack_into("<I", data, position + 9 + 24, crc)
        position += 9 + length
    path.write_bytes(data)


def test_checksums_of_mcap_chunks(tmp_path: Path) -> None:
    measurements = sequence(3.0, shape=(240, 320))
    path = write_bag(tmp_path / "a", "mcap", entries_of(measurements))
    with_checksums(storage(path))
    recording = open_recording(path)
    assert_same(list(recording.stream()), measurements)
    data = bytearray(storage(path).read_bytes())
    data[len(data) // 2] ^= 1
    storage(path).write_bytes(data)
    recording = open_recording(path)
    kept = [m for m in recording.stream() if not isinstance(m, Gap)]
    expected = {fields(m)[0] for m in kept}
    assert_same(kept, [m for m in measurements if fields(m)[0] in expected])
    assert 0 < len(kept) < len(measurements)
    assert "is damaged: its checksum does not match" in recording.report.warnings[0]
    assert recording.report.bytes_lost > 1_000_000


def test_damaged_asl_folders(tmp_path: Path) -> None:
    source = write_asl(tmp_path / "source", MEASUREMENTS)
    rng = np.random.default_rng(2)
    tables = [Path("mav0/cam0/data.csv"), Path("mav0/imu0/data.csv")]
    images = sorted(p.relative_to(source) for p in source.glob("mav0/cam0/data/*.png"))
    for case in range(60):
        path = tmp_path / "damaged"
        shutil.copytree(source, path)
        for file in (tables[case % 2], images[case % len(images)]):
            data = bytearray((path / file).read_bytes())
            position = int(rng.integers(len(data)))
            if case % 3 == 0:
                data = data[:position]
            elif file in images or case % 3 == 1:
                data[position] ^= 1 << int(rng.integers(8))
            (path / file).write_bytes(data)
        if case % 5 == 0:
            (path / images[-1 - case % 7]).unlink()
        found, _, message = read(path)
        _, wrong = originals(found)
        # A digit of one row of the table may be another one; images have checksums.
        assert wrong <= 1, message
        for m in found:
            if isinstance(m, Frame) and wrong == 0:
                assert m.image.shape == (24, 32)
        shutil.rmtree(path)


def test_a_cut_bag_says_how_much_is_lost(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(MEASUREMENTS))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    recording = open_recording(path)
    found = list(recording.stream())
    assert found
    assert_same(found, MEASUREMENTS[: len(found)])
    assert recording.report.bytes_lost > 0.4 * len(data)
    assert f"a.bag was cut or is damaged at byte {len(data) // 2}" in recording.report.warnings[0]


def test_a_recording_without_camera_or_imu(tmp_path: Path) -> None:
    for kind, text in ((Frame, "no IMU"), (ImuSample, "no camera")):
        path = tmp_path / f"{kind.__name__}.bag"
        write_bag(path, "rosbag1", entries_of(m for m in MEASUREMENTS if isinstance(m, kind)))
        with pytest.raises(RecordingError, match=text):
            open_recording(path)


@pytest.mark.parametrize("name", ["metadata.yaml"])
@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"\xff\xfe\x00", b"a: *b", None])
def test_damaged_metadata(name: str, content: bytes | None, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", "sqlite3", entries_of(MEASUREMENTS))
    (path / name).unlink()
    if content is not None:
        (path / name).write_bytes(content)
    recording = open_recording(path)
    assert_same(list(recording.stream()), MEASUREMENTS)
    assert recording.report.warnings[0].startswith("metadata.yaml ")
