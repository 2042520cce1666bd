# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph export` keeps what a recording brings along."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from recordings import T0, compressed_image, entries_of, imu, sequence, write_asl, write_bag
from ruledgraph.app.cli import main
from ruledgraph.calibration import read_calibration
from ruledgraph.core.measurements import Frame
from ruledgraph.recording import open_recording, write_recording
from ruledgraph.recording.ros_calibration import recorded_camera
from small_simulation import SMALL, small_stream

LENS = dataclasses.replace(
    SMALL.camera, distortion="radtan", coefficients=(-0.1, 0.02, 1e-4, -2e-4, 1e-3)
)
SENSORS = dataclasses.replace(SMALL, camera=LENS)
KINDS = {"out.bag": [], "out.mcap": [], "out": ["--format", "rosbag2"]}


def export(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["export", *map(str, arguments)])


def jpeg_bag(path: Path) -> tuple[Path, list[bytes]]:
    """A bag of colour images as JPEG, and their bytes."""
    rng = np.random.default_rng(0)
    entries = [imu(T0 + i * 10**7, [0.0] * 3, [0.0, 0.0, 9.8]) for i in range(100)]
    files = []
    for i in range(9):
        image = rng.integers(0, 255, (24, 32, 3), dtype=np.uint8)
        files.append(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 60])[1].tobytes())
        entries.append(compressed_image(T0 + i * 10**8 + 1, files[-1]))
    return write_bag(path, "rosbag1", sorted(entries, key=lambda e: e.stamp)), files


@pytest.mark.parametrize("out", [*KINDS, "euroc"])
def test_compressed_images_stay_as_they_are(tmp_path, out):
    bag, files = jpeg_bag(tmp_path / "in.bag")
    options = KINDS.get(out, ["--format", "asl"])
    result = export(bag, tmp_path / out, *options)
    assert result.exit_code == 0, result.output
    source, copy = open_recording(bag), open_recording(tmp_path / out)
    kept = [m for m in copy.stream(keep_encoded=True) if isinstance(m, Frame)]
    assert [frame.encoded for frame in kept] == files
    expected = [m for m in source.stream() if isinstance(m, Frame)]
    assert [frame.stamp for frame in kept] == [frame.stamp for frame in expected]
    assert expected[0].encoded is None
    for frame, other in zip(kept, expected, strict=True):
        np.testing.assert_array_equal(frame.image, other.image)
    if out == "euroc":
        assert len(list((tmp_path / out / "mav0" / "cam0" / "data").glob("*.jpg"))) == 9


@pytest.mark.parametrize("out", KINDS)
def test_the_calibration_of_a_folder_is_kept(tmp_path, out):
    write_recording(small_stream(duration=1.5)[0], tmp_path / "in", "asl", calibration=SENSORS)
    result = export(tmp_path / "in", tmp_path / out, *KINDS[out])
    assert result.exit_code == 0, result.output
    assert "out.calib.yaml: calibration" in result.output
    kept = read_calibration(tmp_path / "out.calib.yaml")
    assert (kept.camera, kept.imu_noise) == (SENSORS.camera, SENSORS.imu_noise)
    assert kept.body_T_cam.equals(SENSORS.body_T_cam, 1e-9)
    # It can be smoothed without that file, too.
    camera, body_T_cam = recorded_camera(open_recording(tmp_path / out))
    assert camera == SENSORS.camera
    assert body_T_cam.equals(SENSORS.body_T_cam, 1e-9)
    again = export(tmp_path / "in", tmp_path / "another.bag")
    assert again.exit_code == 0
    (tmp_path / "another.bag").unlink()
    refused = export(tmp_path / "in", tmp_path / "another.bag")
    assert refused.exit_code == 2
    assert "another.calib.yaml exists already" in refused.output
    assert export(tmp_path / "in", tmp_path / "another.bag", "--force").exit_code == 0
    own = export(tmp_path / "another.bag", tmp_path / "another.bag", "--force")
    assert own.exit_code == 2
    assert "another.bag is read from there" in own.output


@pytest.mark.parametrize("out", [*KINDS, "euroc"])
def test_the_calibration_of_a_bag_is_kept(tmp_path, out):
    stream, _ = small_stream(duration=1.5)
    write_recording(stream, tmp_path / "in.mcap", "mcap", calibration=SENSORS)
    result = export(tmp_path / "in.mcap", tmp_path / out, *KINDS.get(out, ["--format", "asl"]))
    assert result.exit_code == 0, result.output
    assert not (tmp_path / "out.calib.yaml").exists()
    if out == "euroc":
        assert not (tmp_path / out / "mav0" / "imu0" / "sensor.yaml").exists()
        kept = read_calibration(tmp_path / out, imu_noise=SENSORS.imu_noise)
        camera, body_T_cam = kept.camera, kept.body_T_cam
    else:
        camera, body_T_cam = recorded_camera(open_recording(tmp_path / out))
    assert camera == SENSORS.camera
    assert body_T_cam.equals(SENSORS.body_T_cam, 1e-9)


def test_a_recording_without_calibration(tmp_path):
    write_asl(tmp_path / "in", sequence())
    assert export(tmp_path / "in", tmp_path / "out.bag").exit_code == 0
    assert [t.name for t in open_recording(tmp_path / "out.bag").topics] == [
        "/cam0/image_raw",
        "/imu0",
    ]
    bag = write_bag(tmp_path / "plain.bag", "rosbag1", entries_of(sequence()))
    assert export(bag, tmp_path / "plain", "--format", "asl").exit_code == 0
    assert not list((tmp_path / "plain").rglob("sensor.yaml"))
