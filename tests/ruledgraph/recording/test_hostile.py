# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings made to do harm: sizes that are lies, bombs, code in YAML, paths that lead elsewhere.

Memory is bounded while they are read: what is claimed must not be allocated.
"""

import bz2
import os
import resource
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
from backports import zstd
from click.testing import CliRunner

from recordings import (
    T0,
    compressed_image,
    entries_of,
    imu,
    raw_image,
    sequence,
    write_asl,
    write_bag,
)
from ruledgraph.app.cli import main
from ruledgraph.core.measurements import Frame
from ruledgraph.recording import RecordingError, open_recording, rosbag2

MEGABYTE = 2**20
FRAMES = 6


@contextmanager
def little_memory(megabytes: int = 400) -> Iterator[None]:
    """Allocations of more than so much on top of what there is fail."""
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + megabytes * MEGABYTE, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def outcome(path: Path) -> tuple[int, str]:
    """Frames that were read, and the error or all warnings."""
    count, text = 0, ""
    with little_memory():
        try:
            recording = open_recording(path)
            for measurement in recording.stream():
                count += isinstance(measurement, Frame)
            text = "; ".join(recording.report.warnings)
        except RecordingError as error:
            text = str(error)
    assert "\n" not in text
    return count, text


def png(width: int, height: int, depth: int = 16, colour: int = 6) -> bytes:
    """An image of zeros whose size in memory is far from that of its file."""

    def chunk(name: bytes, data: bytes) -> bytes:
        crc = zlib.crc32(name + data)
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", crc)

    row = min(1 + (width * depth * {0: 1, 6: 4}[colour] + 7) // 8, 2**20)
    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(row)) for _ in range(min(height, 200)))
    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", rows + packer.flush()) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def jpeg(width: int, height: int) -> bytes:
    frame = struct.pack(">BHHBBBB", 8, height, width, 1, 1, 0x11, 0)
    head = b"\xff\xd8\xff\xc0" + struct.pack(">H", len(frame) + 2) + frame
    return head + b"\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00" + bytes(20) + b"\xff\xd9"


HUGE_IMAGES = {
    "2^31 wide": lambda t: raw_image(t, "mono8", 2**31, 2, 2**31, b"\0" * 64),
    "2^31 high": lambda t: raw_image(t, "mono8", 4, 2**31, 4, b"\0" * 64),
    "steps that overflow": lambda t: raw_image(t, "rgba8", 2**30, 2**30, 2**32 - 1, b"\0" * 64),
    "16 bit, 2^32 - 1": lambda t: raw_image(t, "mono16", 2**32 - 1, 1, 2**32 - 1, b"\0" * 64),
    "png 2^31 wide": lambda t: compressed_image(t, png(2**31 - 1, 1, 8, 0), "png"),
    "png 16000 x 16000": lambda t: compressed_image(t, png(16000, 16000), "png"),
    "png 1 x 2^28": lambda t: compressed_image(t, png(1, 2**28, 8, 0), "png"),
    "jpeg 65535 x 65535": lambda t: compressed_image(t, jpeg(65535, 65535)),
    "jpeg 16000 x 16000": lambda t: compressed_image(t, jpeg(16000, 16000)),
}


@pytest.mark.parametrize("name", HUGE_IMAGES)
def test_sizes_of_images_that_are_lies(name: str, tmp_path: Path) -> None:
    entries = [imu(T0 + i * 10**7) for i in range(40)]
    entries += [HUGE_IMAGES[name](T0 + i * 5 * 10**7 + 1) for i in range(FRAMES)]
    path = write_bag(tmp_path / "a.bag", "rosbag1", sorted(entries, key=lambda e: e.stamp))
    count, text = outcome(path)
    assert count == 0
    assert f"no frame could be used; {FRAMES} were skipped" in text


def record(fields: dict[bytes, bytes], data: bytes, claimed: int | None = None) -> bytes:
    """A record of a ROS 1 bag."""
    parts = [struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields.items()]
    head = b"".join(parts)
    size = len(data) if claimed is None else claimed
    return struct.pack("<I", len(head)) + head + struct.pack("<I", size) + data


def chunk(compression: bytes, data: bytes, full_size: int) -> bytes:
    size = struct.pack("<I", full_size)
    return record({b"op": b"\x05", b"compression": compression, b"size": size}, data)


ZEROS = bytes(64 * MEGABYTE)
HUGE_RECORDS = {
    "lz4, 4 GB claimed": lambda: chunk(b"lz4", lz4.frame.compress(b"abc"), 2**32 - 1),
    "lz4, 1 GB claimed": lambda: chunk(b"lz4", lz4.frame.compress(b"abc"), 2**30),
    "lz4, a bomb": lambda: chunk(b"lz4", lz4.frame.compress(ZEROS * 4), 1000),
    "bz2, 1 GB claimed": lambda: chunk(b"bz2", bz2.compress(b"abc"), 2**30),
    "bz2, a bomb": lambda: chunk(b"bz2", bz2.compress(ZEROS) * 8, 1000),
    "zstd, 1 GB claimed": lambda: chunk(b"zstd", zstd.compress(b"abc"), 2**30),
    "data of 4 GB": lambda: record({b"op": b"\x02", b"conn": bytes(4)}, b"", 2**32 - 1),
    "a header of 4 GB": lambda: struct.pack("<I", 2**32 - 1) + b"op=\x02",
    "a field of 4 GB": lambda: struct.pack("<II", 20, 2**32 - 1) + b"op=\x02" + bytes(20),
}


@pytest.mark.parametrize("name", HUGE_RECORDS)
def test_records_that_claim_to_be_huge(name: str, tmp_path: Path) -> None:
    good = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(sequence()))
    data = good.read_bytes()
    # Behind the file's own header record, 4096 bytes with its padding.
    at = len(b"#ROSBAG V2.0\n") + 4096
    (tmp_path / "b.bag").write_bytes(data[:at] + HUGE_RECORDS[name]() + data[at:])
    count, text = outcome(tmp_path / "b.bag")
    assert text
    assert count in (0, 10)


@pytest.mark.parametrize("size", [2**31, 2**40, 2**62, 2**64 - 1])
@pytest.mark.parametrize("operation", [3, 5, 6])
def test_mcap_records_that_claim_to_be_huge(operation: int, size: int, tmp_path: Path) -> None:
    good = write_bag(tmp_path / "a", "mcap", entries_of(sequence()))
    (file,) = good.glob("*.mcap")
    data = file.read_bytes()
    head = struct.pack("<BQ", operation, min(size, 2**64 - 1)) + struct.pack(
        "<QQQIIQ", 0, 1, size, 0, 0, size
    )
    file.write_bytes(data[:8] + head + data[8:])
    _, text = outcome(good)
    assert text


def test_a_compressed_file_that_would_fill_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    packer = zstd.ZstdCompressor()
    head = b"SQLite format 3\0"
    with (folder / "a.db3.zstd").open("wb") as file:
        file.write(packer.compress(head))
        file.write(packer.compress(ZEROS))
        file.write(packer.flush())
    assert (folder / "a.db3.zstd").stat().st_size < MEGABYTE // 50
    unpacked, sizes = rosbag2._unpacked, []

    def counted(*arguments: Any) -> Iterator[bytes]:
        for piece in unpacked(*arguments):
            sizes.append(len(piece))
            yield piece

    monkeypatch.setattr(rosbag2, "_unpacked", counted)
    monkeypatch.setattr(rosbag2, "_MAX_GROWTH_OF_SMALL", 8 * MEGABYTE)
    _, text = outcome(folder)
    assert "it unpacks to more than 8 MB" in text
    assert 8 * MEGABYTE < sum(sizes) < 10 * MEGABYTE


def test_a_database_whose_tables_are_programs(tmp_path: Path) -> None:
    good = write_bag(tmp_path / "a", "sqlite3", entries_of(sequence()))
    (file,) = good.glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.executescript(
            "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE c(x) AS "
            "(SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS id, 1 AS topic_id, "
            "x AS timestamp, zeroblob(100000000) AS data FROM c;"
        )
    count, text = outcome(good)
    assert count == 0
    assert "messages is no table" in text


@pytest.mark.parametrize(
    "content",
    [
        b"!!python/object/apply:os.system ['touch HERE']",
        b"a: !!python/object/new:subprocess.Popen [['touch', 'HERE']]",
        b"[" * 200_000,
        b"a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n" * 3,
        b"rosbag2_bagfile_information: {relative_file_paths: [../../etc/passwd, 3, null, [1]]}",
        b"rosbag2_bagfile_information: {relative_file_paths: 7}",
        b"x: " + b"y" * 3 * MEGABYTE,
    ],
    ids=["apply", "new", "deep", "aliases", "paths", "number", "large"],
)
def test_metadata_is_only_data(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_bag(tmp_path / "a", "sqlite3", entries_of(sequence()))
    (path / "metadata.yaml").write_bytes(content)
    count, text = outcome(path)
    assert count == 10
    assert text.startswith("metadata.yaml ")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_images_that_are_no_files(tmp_path: Path) -> None:
    path = tmp_path / "a"
    write_asl(path, sequence())
    first, second, third, *_ = sorted(path.glob("mav0/cam0/data/*.png"))
    for image in (first, second, third):
        image.unlink()
    first.symlink_to("/dev/zero")
    os.mkfifo(second)
    third.mkdir()
    count, text = outcome(path)
    assert count == 7
    assert "3 frames skipped: its image file is missing" in text


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/null", "fifo", "fifo.bag"])
def test_recordings_that_are_no_files(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if not path.exists():
        os.mkfifo(path)
    with pytest.raises(RecordingError, match="is no recording"):
        open_recording(path)


def test_topics_named_like_paths_write_nothing_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "deep" / "work"
    work.mkdir(parents=True)
    monkeypatch.chdir(work)
    entries = [
        entry._replace(topic=f"/../../../{'cam0' if 'cam' in entry.topic else 'imu0'}/../../evil")
        if "cam" in entry.topic
        else entry._replace(topic="../../evil")
        for entry in entries_of(sequence(shape=(48, 64)))
    ]
    bag = write_bag(tmp_path / "a.bag", "rosbag1", entries)
    calibration = tmp_path / "calib.yaml"
    calibration.write_text(
        "cam0:\n  T_cam_imu: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"
        "  camera_model: pinhole\n  intrinsics: [50, 50, 32, 24]\n  resolution: [64, 48]\n"
        "  distortion_model: none\n  distortion_coeffs: []\n  rostopic: ../../evil\n"
    )
    before = set(tmp_path.rglob("*"))
    for command in (
        ["export", bag, "out", "--format", "asl"],
        ["export", bag, "out.bag", "--format", "rosbag1"],
        ["smooth", bag, "--calibration", calibration, "--imu", "d435i", "--output", "run"],
        ["info", bag],
    ):
        result = CliRunner().invoke(main, list(map(str, command)))
        # Too short for an estimate.
        assert result.exit_code == (3 if command[0] == "smooth" else 0), result.output
    new = set(tmp_path.rglob("*")) - before
    assert {p.relative_to(work).parts[0] for p in new} == {"out", "out.bag", "run"}


def test_nothing_is_written_over(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(sequence()))
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "mine.txt").write_text("mine")
    file = tmp_path / "mine.txt"
    file.write_text("mine")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "nowhere")
    pose = "\n".join(f"{i} {i} {i * i} 0 0 0 0 1" for i in range(9))
    (tmp_path / "p.tum").write_text(pose + "\n")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    poses = tmp_path / "p.tum"
    for command in (
        ["export", bag, kept, "--format", "asl"],
        ["export", bag, file, "--format", "mcap"],
        ["export", bag, link, "--format", "rosbag1"],
        ["simulate", "square", "free", file, "--format", "rosbag1"],
        ["simulate", "square", "free", "--preview", file],
        ["evaluate", poses, poses, "--plots", kept],
        ["evaluate", poses, poses, "--save", kept],
        ["evaluate", poses, poses, "--save", file],
        ["info", bag, "--plots", kept],
        ["info", bag, "--plots", file],
    ):
        result = CliRunner().invoke(main, list(map(str, command)))
        assert result.exit_code == 2, command
        assert result.output.startswith("ruledgraph: "), result.output
        assert len(result.output.splitlines()) == 1
    after = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert after == before
