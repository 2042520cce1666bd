# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph info` as a doctor: every fault has a line that says what to do."""

import dataclasses
import json
from pathlib import Path

import gtsam
import numpy as np
import pytest
from click.testing import CliRunner

from recordings import T0, Entry, entries_of, new, sequence, write_asl, write_bag
from ruledgraph.app.cli import main
from ruledgraph.calibration import write_kalibr
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import D435I_LIKE, ImuNoise
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.core.settings import load_config
from ruledgraph.diagnostics.checks import Observations, examine, examine_calibration, rests
from ruledgraph.diagnostics.info import inspect_recording
from ruledgraph.diagnostics.readout_check import examine_readout
from ruledgraph.recording import write_recording
from small_simulation import SMALL, small_stream

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("checks")

RATE = 200
EPOCH = 10**18
NOISE = ImuNoise(2.0e-4, 2.0e-3, 1e-5, 1e-4)
IMAGE = np.zeros((4, 4), np.uint8)


def healthy(seconds: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    """IMU times and readings: two seconds of rest, then motion."""
    rng = np.random.default_rng(0)
    times = np.arange(0.0, seconds, 1.0 / RATE)
    imu = rng.normal(size=(len(times), 6)) * np.repeat([2e-4, 2e-3], 3) * np.sqrt(RATE)
    imu[:, 5] += 9.81
    moving = times > 2.0
    waves = np.sin(2.0 * np.pi * np.outer(times - 2.0, [0.7, 0.9, 1.1, 0.8, 1.2, 1.0]))
    imu[moving] += waves[moving] * [0.5, 0.4, 0.6, 2.0, 2.0, 2.0]
    return times, imu


def observed(times, imu, frame_times=None) -> Observations:
    seen = Observations()
    for t, reading in zip(times, imu, strict=True):
        seen.add(ImuSample(EPOCH + round(t * 1e9), reading[:3], reading[3:]))
    for t in np.arange(0.0, times[-1], 1 / 30) if frame_times is None else frame_times:
        seen.add(Frame(EPOCH + round(t * 1e9), IMAGE))
    return seen


def bad(findings) -> list[str]:
    return [finding.text for finding in findings if not finding.good]


@pytest.mark.parametrize("samples", [1, 20, 900])
def test_where_it_turns_most_there_is_something_to_read(samples):
    times, imu = healthy(5.0 + samples / RATE)
    imu[-samples:, 0] += 5.0
    assert observed(times, imu).liveliest(2.0) == (7.0 if samples > 500 else 2.0)


def test_a_healthy_recording_has_nothing_to_complain_of():
    findings = list(examine(observed(*healthy()), NOISE))
    assert bad(findings) == []
    text = "\n".join(finding.text for finding in findings)
    for part in ("every 5 ms", "every 33.3 ms", "it moves", "starts at rest", "shows 9.81 m/s^2"):
        assert part in text
    assert "the gyroscope's noise at rest is 0.0002" in text


def turned_up(times, imu):
    imu[:, 3:] *= 0.9
    return times, imu


def frozen(times, imu):
    imu[700:720] = imu[700]
    return times, imu


def saturated(times, imu):
    imu[:, 1] = np.clip(imu[:, 1], -0.25, 0.25)
    return times, imu


def noisy(times, imu):
    imu[:, :3] += np.random.default_rng(1).normal(size=(len(imu), 3)) * 0.01
    return times, imu


def biased(times, imu):
    imu[:, 0] += 0.2
    return times, imu


def resting(times, imu):
    return times, np.tile(imu[:400], (3, 1))


def moving(times, imu):
    return times[:800], imu[400:]


def slow(times, imu):
    return times[::4], imu[::4]


def lossy(times, imu):
    kept = np.random.default_rng(0).random(len(times)) > 0.1
    return times[kept], imu[kept]


def bunched(times, imu):
    late = np.ceil(times * 100.0) / 100.0 + np.tile([0.0, 0.0005], len(times) // 2)
    return late, imu


def in_bursts(times, imu):
    """Five readings at once, stamped as they arrive."""
    return np.repeat(times[4::5], 5) + np.tile(1e-5 * np.arange(5), len(times) // 5), imu


def late(times, imu):
    """Stamps of arrival, by up to two steps late."""
    delays = np.random.default_rng(0).uniform(0.0, 2.0 * np.diff(times)[0], len(times))
    return np.sort(times + delays), imu


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (turned_up, "at rest the accelerometer shows 8.83 instead of 9.81 m/s^2; check its unit"),
        (frozen, "the IMU gives the same reading 20 times in a row"),
        (saturated, "the gyroscope's y stays at 0.25 rad/s for"),
        (noisy, "times the calibration's; raise that"),
        (biased, "at rest the gyroscope shows 0.2 rad/s; calibrate it"),
        (resting, "it hardly moves"),
        (moving, "it starts in motion"),
        (moving, "it never rests for 1 s"),
        (slow, "the IMU runs at 50 Hz; record at 100 Hz at the least"),
        (lossy, "% of the IMU's measurements are missing"),
        (bunched, "of a step uneven; are they times of arrival?"),
        (in_bursts, "the IMU's stamps are 159% of a step uneven"),
        (late, "of a step uneven; are they times of arrival?"),
    ],
)
def test_what_is_wrong_is_found(change, message):
    times, imu = healthy()
    found = bad(examine(observed(*change(times, imu)), NOISE))
    assert any(message in text for text in found), found
    assert all("\n" not in text for text in found)


@pytest.mark.parametrize("change", [in_bursts, late])
def test_uneven_stamps_are_no_losses(change):
    found = list(examine(observed(*change(*healthy())), NOISE))
    assert not any("missing" in finding.text for finding in found if "IMU" in finding.text), found
    assert not any("Hz" in finding.text for finding in found if "runs at" in finding.text), found


def test_lost_frames_are_found():
    times, imu = healthy()
    frames = np.arange(0.0, 6.0, 1 / 30)
    kept = frames[np.random.default_rng(0).random(len(frames)) > 0.2]
    found = bad(examine(observed(times, imu, kept), NOISE))
    assert len(found) == 1
    assert "of the camera's measurements are missing; record fewer topics" in found[0]


def test_noise_in_other_units_is_found():
    tiny = ImuNoise(*(1e3 * value for value in vars(NOISE).values()))
    found = bad(examine(observed(*healthy()), tiny))
    assert sum("is that in the right unit?" in text for text in found) == 2


def test_rest_is_told_from_motion():
    times, imu = healthy()
    resting = rests(times, imu)
    assert resting[times < 1.9].all()
    assert not resting[times > 2.1].any()


def test_the_settings_say_what_rests_and_how_large_a_bias_may_be():
    times, imu = biased(*healthy())
    seen = observed(times, imu)
    assert any("start.gyroscope_bias" in text for text in bad(examine(seen, NOISE)))
    assert bad(examine(seen, NOISE, load_config(None, ["start.gyroscope_bias=0.3"]))) == []
    strict = bad(examine(seen, NOISE, load_config(None, ["rest.velocity_sigma=1e-6"])))
    assert any("it never rests for 1 s" in text for text in strict)


def test_few_measurements_are_not_judged():
    assert list(examine(Observations())) == []
    assert list(examine(observed(np.arange(10) / RATE, np.zeros((10, 6)), []))) == []


def test_a_readout_has_to_fit_between_the_frames():
    times = np.arange(30) / 30.0
    assert list(examine_readout(SMALL, times)) == []
    (good,) = examine_readout(SMALL.with_readout(0.02), times)
    assert (good.good, good.text) == (True, "a rolling shutter: rows are read within 20.0 ms")
    (wrong,) = bad(examine_readout(SMALL.with_readout(0.05), times))
    assert wrong.startswith("rows are read within 50.0 ms, but frames are 33.3 ms apart;")


CAMERA = CameraModel(640, 480, 385.0, 385.0, 320.0, 240.0)


@pytest.mark.parametrize(
    ("changes", "size", "message"),
    [
        ({}, (640, 480), None),
        ({}, (1280, 720), "images are 1280x720, the calibration is for 640x480"),
        ({"camera": dataclasses.replace(CAMERA, fx=38.5, fy=38.5)}, None, "focal lengths of 38.5"),
        ({"camera": dataclasses.replace(CAMERA, fy=800.0)}, None, "focal lengths of 385 and 800"),
        ({"camera": dataclasses.replace(CAMERA, cx=120.0)}, None, "the principal point (120, 240)"),
        (
            {"body_T_cam": gtsam.Pose3(gtsam.Rot3(), np.array([50.0, 0.0, 10.0]))},
            None,
            "the camera is 51 m from the IMU; is its translation in metres?",
        ),
        ({"time_offset": -5.0}, None, "the time offset of -5 s is large"),
        (
            {"imu_noise": dataclasses.replace(D435I_LIKE, gyroscope=0.1)},
            None,
            "the gyroscope's noise density of 0.1 is no IMU's",
        ),
    ],
)
def test_calibrations(changes, size, message):
    calibration = dataclasses.replace(SMALL, camera=CAMERA)
    found = bad(examine_calibration(dataclasses.replace(calibration, **changes), size))
    assert found == [] if message is None else message in found[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, None),
        ({"fx": 1.01 * SMALL.camera.fx}, None),
        ({"fx": 1.2 * SMALL.camera.fx, "fy": 1.2 * SMALL.camera.fy}, "focal lengths"),
        ({"distortion": "radtan", "coefficients": (-0.3, 0.1, 0.0, 0.0)}, "rectification"),
        ({"fx": 2.0 * SMALL.camera.fx, "fy": 9.9 * SMALL.camera.fx}, "camera_info differ by"),
    ],
)
@pytest.mark.parametrize("kind", ["rosbag1", "mcap"])
def test_calibration_and_camera_info_are_compared(tmp_path, kind, changes, message):
    stream, _ = small_stream()
    path = tmp_path / "recording"
    write_recording(stream[:60], path, kind, calibration=SMALL)
    camera = dataclasses.replace(SMALL.camera, **changes)
    other = dataclasses.replace(SMALL, camera=camera)
    found = inspect_recording(path, calibrate=lambda *_: other).findings
    (compared,) = [finding for finding in found if "camera_info" in finding.text]
    assert compared.good == (message is None)
    assert message is None or message in compared.text


def test_the_camera_info_of_an_uncalibrated_camera_is_passed_over(tmp_path):
    """Drivers fill it with zeros."""
    region = new("cdr", "sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    empty = {"d": np.zeros(5), "k": np.zeros(9), "r": np.zeros(9), "p": np.zeros(12)}
    size = {"height": SMALL.camera.height, "width": SMALL.camera.width}
    said = {**size, "distortion_model": "plumb_bob", **empty}
    said |= {"binning_x": 0, "binning_y": 0, "roi": region}
    info = Entry("/cam0/camera_info", "sensor_msgs/msg/CameraInfo", T0, said)
    path = write_bag(tmp_path / "recording", "sqlite3", [info, *entries_of(sequence())])
    found = inspect_recording(path, calibrate=lambda *_: SMALL)
    assert "/cam0/camera_info" in [topic.name for topic in found.topics]
    assert not [finding for finding in found.findings if "camera_info" in finding.text]


def info(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["info", *map(str, arguments)])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    stream, calibration = small_stream(moving=True)
    write_recording(stream, folder / "a.bag", "rosbag1")
    write_kalibr(calibration, folder / "calib.yaml")
    return folder


def test_the_command_says_what_it_found(recording, tmp_path):
    bag, calibration = recording / "a.bag", recording / "calib.yaml"
    code, text = info(bag, "--calibration", calibration, "--plots", tmp_path / "plots")
    assert code == 0, text
    assert "Good     the camera is 13.9 mm from the IMU" in text
    assert "Good     the images turn as the gyroscope says" in text
    assert "Check    it starts in motion" in text
    assert f"Plot     {tmp_path / 'plots' / 'timing.png'}" in text
    assert (tmp_path / "plots" / "timing.png").stat().st_size > 10_000
    # The good before the bad, so that what is to be done stands at the end.
    words = [line.split()[0] for line in text.splitlines() if line.startswith(("Good", "Check"))]
    assert words == sorted(words, reverse=True)
    code, text = info(bag, "--json")
    assert code == 0
    found = json.loads(text)
    assert {"good", "text"} == set(found["findings"][0])
    assert found["plot"] is None


def test_a_calibration_that_cannot_be_read(recording, tmp_path):
    code, text = info(recording / "a.bag", "--calibration", tmp_path / "none.yaml")
    assert code == 2
    assert (
        text == f"ruledgraph: {tmp_path / 'none.yaml'}: cannot be read: No such file or directory\n"
    )


def test_a_folder_brings_its_calibration_or_needs_none(tmp_path):
    stream, calibration = small_stream(moving=True)
    short = stream[:300]
    code, text = info(write_asl(tmp_path / "without", short))
    assert code == 0, text
    assert "from the IMU" not in text
    write_recording(short, tmp_path / "with", "asl", calibration=calibration)
    code, text = info(tmp_path / "with")
    assert code == 0, text
    assert "Good     the camera is 13.9 mm from the IMU" in text


@pytest.mark.parametrize("turned", [False, True])
def test_the_gyroscope_is_compared_with_a_recordings_own_calibration(tmp_path, turned):
    stream, calibration = small_stream(moving=True)
    if turned:
        pose = calibration.body_T_cam.compose(gtsam.Pose3(gtsam.Rot3.Rx(np.pi / 2), np.zeros(3)))
        calibration = dataclasses.replace(calibration, body_T_cam=pose)
    write_recording(stream, tmp_path / "a.mcap", "mcap", calibration=calibration)
    texts = {f.text: f.good for f in inspect_recording(tmp_path / "a.mcap").findings}
    (own,) = [good for text, good in texts.items() if "smooth needs only --imu" in text]
    assert own
    assert any("gyroscope says" in text and good for text, good in texts.items()) != turned
    assert any("with the rotation" in text and not good for text, good in texts.items()) == turned
