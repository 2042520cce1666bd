# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""RealSense cameras, played by librealsense's software device."""

import dataclasses
import re
import threading
import time

import gtsam
import numpy as np
import pytest

from ruledgraph.app.live_command import live_command
from ruledgraph.calibration import TYPICAL_IMU_NOISE, read_calibration
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.live.realsense import RealSense, connected_device
from ruledgraph.recording import open_recording
from small_simulation import frames, small_stream
from software_realsense import SoftwareRealSense, at_pace, rs

NOISE = TYPICAL_IMU_NOISE["d435i"]
SECOND = 1_000_000_000
# Just before the counter of the device's clock begins anew, ns.
LATE = 2**32 * 1000 - SECOND


def received(calibration, measurements, shift):
    software = SoftwareRealSense(calibration)
    images, samples = [], []
    with RealSense(software.device, 320, 240, 30) as camera:
        camera.start(
            lambda image, stamp: images.append((image.copy(), stamp)),
            lambda *sample: samples.append(sample),
        )
        software.play(measurements, shift)
        deadline = time.monotonic() + 10.0
        while len(images) < len(frames(measurements)) and time.monotonic() < deadline:
            camera.check()
            time.sleep(0.01)
    assert software.camera.get_option(rs.option.emitter_enabled) == 0.0
    return images, samples


def test_the_device_tells_its_calibration():
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.1, -0.2, 0.3), np.array([-0.0055, 0.0051, 0.0117]))
    calibration = dataclasses.replace(small_stream()[1], body_T_cam=pose)
    found = RealSense(SoftwareRealSense(calibration).device, 320, 240, 30).calibration(NOISE)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found.camera, name) == pytest.approx(getattr(calibration.camera, name))
    assert found.camera.distortion == "none"
    assert found.body_T_cam.equals(calibration.body_T_cam, 1e-6)
    assert found.imu_noise == NOISE


@pytest.mark.parametrize("begin", [SECOND, LATE])
def test_measurements_arrive_as_they_were(begin):
    stream, calibration = small_stream()
    shift = begin - stream[0].stamp
    stream = stream[: len(stream) // 2]
    images, samples = received(calibration, stream, shift)
    sent = frames(stream)
    # A queue in librealsense may drop some when they come all at once.
    assert len(images) > 0.5 * len(sent)
    by_stamp = {round((frame.stamp + shift) / 1e3): frame.image for frame in sent}
    for image, stamp in images:
        np.testing.assert_array_equal(image, by_stamp[round(stamp / 1e3)])
    readings = {round((m.stamp + shift) / 1e3): m for m in stream if isinstance(m, ImuSample)}
    assert len(samples) > 0.5 * len(readings)
    for gyroscope, accelerometer, stamp in samples:
        sample = readings[round(stamp / 1e3)]
        np.testing.assert_allclose(gyroscope, sample.gyroscope, atol=1e-5)
        np.testing.assert_allclose(accelerometer, sample.accelerometer, atol=1e-5)


def test_what_a_device_lacks_is_named():
    _, calibration = small_stream()
    with pytest.raises(RuledgraphError, match="no infrared images of 640x480 at 90 Hz"):
        RealSense(SoftwareRealSense(calibration).device)
    with pytest.raises(RuledgraphError, match="has no IMU"):
        RealSense(SoftwareRealSense(calibration, imu=False).device, 320, 240, 30)
    with pytest.raises(RuledgraphError, match="no RealSense camera is connected"):
        connected_device()


def test_stamps_of_the_computer_are_refused():
    stream, calibration = small_stream()
    software = SoftwareRealSense(calibration)
    software.use_computer_clock()
    with RealSense(software.device, 320, 240, 30) as camera:
        camera.start(lambda *_: None, lambda *_: None)
        software.play(stream[:50], SECOND - stream[0].stamp)
        time.sleep(0.2)
        with pytest.raises(RuledgraphError, match="not of the camera's clock"):
            camera.check()


def test_the_command_prints_poses_and_records(tmp_path, capsys):
    stream, calibration = small_stream()
    software = SoftwareRealSense(calibration)
    player = threading.Thread(
        target=software.play, args=(stream, LATE - stream[0].stamp, at_pace())
    )
    options = {
        "calibration_files": (),
        "camera": None,
        "imu": None,
        "readout": None,
        "resolution": "320x240",
        "rate": 30,
        "duration": 5.5,
        "record": tmp_path / "room.mcap",
        "config_file": None,
        "settings": (),
        "force": False,
    }
    starter = threading.Timer(0.3, player.start)
    starter.start()
    live_command(**options, device=software.device)
    player.join()
    lines = capsys.readouterr().out.splitlines()
    assert any(re.match(r"[0-9.]+ s( +-?[0-9.]+){3} m ±[0-9.]+  [a-z ]+", line) for line in lines)
    recorded = [m for m in open_recording(tmp_path / "room.mcap").stream() if isinstance(m, Frame)]
    assert len(recorded) > 0.8 * len(frames(stream))
    beside = read_calibration(tmp_path / "room.calib.yaml")
    assert beside.body_T_cam.equals(calibration.body_T_cam, 1e-6)
    with pytest.raises(RuledgraphError, match="exists already"):
        live_command(**options, device=software.device)
