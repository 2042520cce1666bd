# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph info` and `ruledgraph export`, also on a real recording."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from recordings import (
    MS,
    SECOND,
    T0,
    assert_same,
    entries_of,
    fields,
    image,
    imu,
    sequence,
    texture,
    write_asl,
    write_bag,
)
from ruledgraph.calibration import write_kalibr
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.diagnostics.info import inspect_recording
from ruledgraph.recording import Kind, open_recording, write_recording
from small_simulation import small_stream

REAL_BAG = Path(__file__).parents[4] / "shared/data/euroc_MH_01_30s/MH_01_30s.bag"
needs_real_bag = pytest.mark.skipif(
    not REAL_BAG.exists(), reason=f"the EuRoC recording is not at {REAL_BAG}"
)


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ruledgraph", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_info_for_people(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(sequence(2.0)))
    result = run("info", path)
    assert (result.returncode, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    assert lines[0] == f"{path}: ROS 1 bag"
    assert lines[2].split() == [
        "/cam0/image_raw", "sensor_msgs/msg/Image", "20", "10", "Hz", "100.0", "ms",
    ]  # fmt: skip
    assert "Camera   /cam0/image_raw: 20 images at 10 Hz, 16x12, longest step 100.0 ms" in lines
    assert "IMU      /imu0: 200 samples at 100 Hz, longest step 10.0 ms" in lines
    assert "Overlap  1.90 s of both" in lines


def test_info_as_json(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", "mcap", entries_of(sequence(2.0)))
    result = run("info", path, "--json", "--start", 0.5, "--duration", 1)
    assert (result.returncode, result.stderr) == (0, "")
    found = json.loads(result.stdout)
    assert found["kind"] == "rosbag2"
    assert [topic["messages"] for topic in found["topics"]] == [20, 200]
    assert [topic["read"] for topic in found["topics"]] == [20, 200]
    assert (found["camera"]["count"], found["imu"]["count"]) == (10, 100)
    assert found["imu"]["first_stamp"] == T0 + 500 * MS
    assert found["image_size"] == [16, 12]
    assert found["missing"] == found["warnings"] == []


def test_info_decodes_the_first_images_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ruledgraph.diagnostics import info

    decoded = []
    decode = info.decode_image
    monkeypatch.setattr(info, "decode_image", lambda *a: decoded.append(a) or decode(*a))
    path = write_bag(tmp_path / "a.bag", "rosbag1", entries_of(sequence(2.0)))
    found = inspect_recording(path)
    assert found.camera is not None
    assert (found.camera.count, len(decoded)) == (20, 5)


@pytest.mark.parametrize(
    ("kept", "missing"),
    [(Frame, "no IMU: no topic with IMU samples"), (ImuSample, "no camera: no topic with images")],
)
def test_info_without_camera_or_imu(kept: type, missing: str, tmp_path: Path) -> None:
    entries = entries_of(m for m in sequence() if isinstance(m, kept))
    path = write_bag(tmp_path / "a", "sqlite3", entries)
    result = run("info", path)
    assert (result.returncode, result.stderr) == (2, "")
    assert f"Missing  {missing}" in result.stdout
    found = inspect_recording(path)
    assert (found.camera is None) == (kept is ImuSample)
    assert (found.imu is None) == (kept is Frame)


def test_info_of_a_stretch_without_frames(tmp_path: Path) -> None:
    stream, calibration = small_stream(duration=1.0)
    write_recording(stream, tmp_path / "a.bag", "rosbag1")
    write_kalibr(calibration, tmp_path / "calib.yaml")
    given = "--calibration", tmp_path / "calib.yaml", "--start", 100
    result = run("info", tmp_path / "a.bag", *given)
    assert "Traceback" not in result.stderr
    assert result.returncode == 2
    assert "Missing  no " in result.stdout


def test_info_says_what_is_wrong(tmp_path: Path) -> None:
    entries = [imu(T0 + i * 10 * MS, a=(0.0, 0.0, 1.0)) for i in range(200) if not 50 < i < 120]
    entries += [image(T0 + i * 100 * MS + MS, texture(i), f"/cam{i % 2}") for i in range(10)]
    entries.sort(key=lambda entry: entry.stamp)
    path = write_bag(tmp_path / "a.bag", "rosbag1", entries)
    result = run("info", path)
    assert result.returncode == 2
    assert (
        "Missing  several topics hold images, choose with: "
        "--image-topic /cam0 or --image-topic /cam1" in result.stdout
    )
    assert "the IMU was silent 1 time, for up to 0.70 s" in result.stdout
    assert "is it in g?" in result.stdout
    chosen = run("info", path, "--image-topic", "/cam1")
    assert chosen.returncode == 0
    assert "Missing" not in chosen.stdout


def test_info_of_stamps_that_do_not_overlap(tmp_path: Path) -> None:
    later = [
        e._replace(stamp=e.stamp + 100 * SECOND) if e.topic == "/imu0" else e
        for e in entries_of(sequence())
    ]
    result = run("info", write_bag(tmp_path / "a.bag", "rosbag1", later), "--json")
    assert result.returncode == 2
    assert "the stamps do not overlap" in json.loads(result.stdout)["missing"][0]


def test_info_counts_the_images_that_cannot_be_read(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "asl", sequence(3.0))
    images = sorted(folder.rglob("cam0/data/*.png"))
    for image_file in images[8:12]:
        image_file.unlink()
    for image_file in images[20:23]:
        image_file.write_bytes(image_file.read_bytes()[:-20])
    found = inspect_recording(folder)
    assert found.camera is not None
    assert found.camera.count == 23
    assert "4 frames skipped: its image file is missing" in found.warnings
    assert "3 frames skipped: a PNG image is cut" in found.warnings


def test_info_of_a_single_image(tmp_path: Path) -> None:
    stream, calibration = small_stream(duration=4.5)
    one = next(m for m in stream if isinstance(m, Frame))
    kept = [m for m in stream if m is one or isinstance(m, ImuSample)]
    write_recording(kept, tmp_path / "a.bag", "rosbag1")
    found = inspect_recording(tmp_path / "a.bag", calibrate=lambda *_: calibration)
    at = (one.stamp - stream[0].stamp) * 1e-9
    said = f"only 1 image, at {at:.2f} s: at least 10 Hz for 1.6 s are needed"
    assert found.findings[-1].text == said


def test_info_of_a_recording_that_is_too_short_to_start_in_motion(tmp_path: Path) -> None:
    stream, _ = small_stream(duration=4.5)
    for length, is_short in ((1.0, True), (2.5, False)):
        path = tmp_path / f"{length}.bag"
        write_recording(
            [m for m in stream if m.stamp < stream[0].stamp + length * 1e9], path, "rosbag1"
        )
        found = inspect_recording(path)
        texts = [finding.text for finding in found.findings if not finding.good]
        assert any("long: a start in motion takes at least" in text for text in texts) == is_short


def test_export(tmp_path: Path) -> None:
    measurements = sequence(2.0)
    path = write_bag(tmp_path / "a.bag", "rosbag1-lz4", entries_of(measurements))
    out = tmp_path / "folder"
    result = run("export", path, out, "--format", "asl", "--duration", 1)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == f"{out}: 10 frames, 100 IMU samples\n"
    assert_same(
        list(open_recording(out).stream()), [m for m in measurements if fields(m)[0] < T0 + SECOND]
    )
    again = run("export", path, out, "--format", "rosbag2")
    assert (again.returncode, again.stdout) == (2, "")
    assert again.stderr == (f"ruledgraph: {out} exists already; remove it or choose another name\n")


def test_errors_are_one_line(tmp_path: Path) -> None:
    for command in (["info", tmp_path / "x"], ["export", tmp_path / "x", "y", "--format", "asl"]):
        result = run(*command)
        assert (result.returncode, result.stdout) == (2, "")
        assert result.stderr == f"ruledgraph: {tmp_path / 'x'} does not exist\n"


@needs_real_bag
def test_info_on_a_real_recording() -> None:
    result = run("info", REAL_BAG)
    assert result.returncode == 0
    assert "600 images at 20 Hz, 752x480" in result.stdout
    assert "5996 samples at 200 Hz" in result.stdout
    assert "Missing" not in result.stdout


@needs_real_bag
@pytest.mark.parametrize("kind", ["rosbag1", "rosbag2", "mcap", "asl"])
def test_a_real_recording_exported_and_back(kind: Kind, tmp_path: Path) -> None:
    """Through the format and back to a ROS 1 bag, bit for bit."""
    source = open_recording(REAL_BAG, start=3.0, duration=1.5)
    expected = list(source.stream())
    assert len([m for m in expected if isinstance(m, Frame)]) == 30
    write_recording(source.stream(), tmp_path / "there", kind)
    there = open_recording(tmp_path / "there")
    assert_same(list(there.stream()), expected)
    write_recording(there.stream(), tmp_path / "back", "rosbag1")
    assert_same(list(open_recording(tmp_path / "back").stream()), expected)


@needs_real_bag
def test_a_real_recording_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "cut.bag"
    with REAL_BAG.open("rb") as file:
        path.write_bytes(file.read(10_000_000))
    recording = open_recording(path)
    found = list(recording.stream())
    whole = open_recording(REAL_BAG, duration=(found[-1][0] - found[0][0]) * 1e-9)
    assert_same(found[:-20], list(whole.stream())[: len(found) - 20])
    assert recording.report.bytes_lost > 70_000_000
