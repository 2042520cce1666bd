# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration of a recording by its own CameraInfo and static transforms."""

from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest
from click.testing import CliRunner

from recordings import CAMERA_INFO, T0, TRANSFORMS, Entry, entries_of, new, sequence, write_bag
from ruledgraph.app.cli import main
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.recording import RecordingError, Topic, open_recording
from ruledgraph.recording.ros_calibration import recorded_camera

OPTICAL = (-0.5, 0.5, -0.5, 0.5)
NONE = (0.0, 0.0, 0.0, 1.0)
TILTED = (0.0, 0.0, np.sin(0.05), np.cos(0.05))
# As RealSense cameras have them: every sensor beside the mount, turned into optical axes.
TREE = [
    ("base", "mount", (1.0, 2.0, 3.0), TILTED),
    ("mount", "infra", (0.0, 0.01, 0.0), TILTED),
    ("infra", "infra_optical", (0.0, 0.0, 0.0), OPTICAL),
    ("mount", "gyro", (-0.01, 0.005, 0.01), NONE),
    ("gyro", "gyro_optical", (0.0, 0.0, 0.0), OPTICAL),
    ("mount", "accel", (-0.01, 0.025, 0.01), NONE),
    ("accel", "accel_optical", (0.0, 0.0, 0.0), OPTICAL),
]
FIGURES = {"d": [-0.3, 0.1, 0.0, 0.0, 0.0], "k": [12.0, 0, 8.1, 0, 12.5, 6.2, 0, 0, 1]}


def info(**changes: Any) -> Entry:
    region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    fields = {
        "height": 12,
        "width": 16,
        "distortion_model": "plumb_bob",
        **FIGURES,
        "r": np.eye(3).ravel(),
        "p": [11.0, 0, 8.0, 0, 0, 11.0, 6.0, 0, 0, 0, 1, 0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": new("cdr", "sensor_msgs/msg/RegionOfInterest", **region),
        **changes,
    }
    fields |= {name: np.array(fields[name], dtype=float) for name in "dkrp"}
    return Entry("/cam0/camera_info", CAMERA_INFO, T0, fields, frame="infra_optical")


def recorded(
    path: Path, *more: Entry, bag: str = "sqlite3", images: str = "/cam0/image_raw"
) -> Path:
    """Images, a gyroscope and an accelerometer, each with a frame of its own."""
    entries = list(more)
    for entry in entries_of(sequence()):
        if entry.topic == "/imu0":
            entries += [
                entry._replace(topic=f"/{half}/sample", frame=f"{half}_optical")
                for half in ("gyro", "accel")
            ]
        else:
            entries.append(entry._replace(topic=images))
    return write_bag(path / "recording.bag", bag, sorted(entries, key=lambda entry: entry.stamp))


def static(*rows: Any) -> Entry:
    return Entry("/tf_static", TRANSFORMS, T0, {"all": list(rows)})


@pytest.mark.parametrize("bag", ["rosbag1", "sqlite3", "mcap"])
def test_camera_and_mounting_are_those_the_drivers_published(tmp_path, bag):
    # In two messages, as two nodes publish them.
    path = recorded(tmp_path, info(), static(*TREE[:3]), static(*TREE[3:]), bag=bag)
    camera, body_T_cam = recorded_camera(open_recording(path))
    assert camera == CameraModel(16, 12, 12.0, 12.5, 8.1, 6.2, "radtan", (-0.3, 0.1, 0.0, 0.0, 0.0))
    # A point 2 m before the lens, seen from the mount and then in the accelerometer's optical axes.
    cosine, sine = np.cos(0.1), np.sin(0.1)
    in_mount = np.array([2.0 * cosine, 2.0 * sine + 0.01, 0.0])
    x, y, z = in_mount - [-0.01, 0.025, 0.01]
    ahead = body_T_cam.transformFrom(np.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(ahead, [-y, -z, x], atol=1e-12)


def test_rectified_images_have_the_projection_matrix(tmp_path):
    path = recorded(tmp_path, info(), static(*TREE), images="/cam0/image_rect")
    camera, _ = recorded_camera(open_recording(path))
    assert camera == CameraModel(16, 12, 11.0, 11.0, 8.0, 6.0)


def test_the_camera_may_hang_below_the_imu(tmp_path):
    tree = [row for row in TREE if row[1] not in ("infra", "infra_optical")]
    tree.append(("accel_optical", "infra_optical", (0.1, 0.2, 0.3), NONE))
    _, body_T_cam = recorded_camera(open_recording(recorded(tmp_path, info(), static(*tree))))
    assert body_T_cam.equals(gtsam.Pose3(gtsam.Rot3(), [0.1, 0.2, 0.3]), 1e-12)


def changed(child: str, t: tuple[float, ...] = (0.0, 0.0, 0.0), q: tuple[float, ...] = NONE):
    return [(*row[:2], t, q) if row[1] == child else row for row in TREE]


WITHOUT_CAMERA = [row for row in TREE if row[1] != "infra"]
LOOP = [*WITHOUT_CAMERA, ("infra_optical", "infra", (0.0, 0.0, 0.0), NONE)]


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([static(*TREE)], "/cam0/camera_info was not recorded"),
        ([info()], "/tf_static was not recorded"),
        ([info(k=np.zeros(9)), static(*TREE)], "/cam0/camera_info: CameraInfo message: K"),
        ([info()._replace(frame=""), static(*TREE)], "/cam0/camera_info: its messages name no"),
        ([info(), static(*WITHOUT_CAMERA)], "not connect 'accel_optical' and 'infra_optical'"),
        ([info(), static(*LOOP)], "'infra_optical' is its own parent"),
        ([info(), static(*changed("accel_optical"))], "'gyro_optical' and 'accel_optical' are"),
        ([info(), static(*changed("mount", q=(0.0,) * 4))], "the transform of 'mount' is no pose"),
        ([info(), static(*changed("mount", q=(1e200,) * 4))], "of 'mount' is no pose"),
        ([info(), static(*changed("mount", (np.nan, 0.0, 0.0)))], "of 'mount' is no pose"),
        ([info(), static(*changed("infra", (11.0, 0.0, 0.0)))], "the camera is 11 m from the IMU"),
        ([info(), static(*changed("infra", (1e308,) * 3))], "it must be in metres"),
        ([info(), static(("x", "y" * 9000, (np.nan,) * 3, NONE))], "'y{40}' is no pose"),
    ],
)
def test_what_is_missing_or_makes_no_sense_is_named(tmp_path, entries, message):
    path = recorded(tmp_path, *entries)
    with pytest.raises(RecordingError, match=message):
        recorded_camera(open_recording(path))
    result = CliRunner().invoke(main, ["smooth", str(path), "--imu", "d435i"])
    assert result.exit_code == 2
    assert "pass --calibration FILE" in result.output
    assert len(result.output.splitlines()) == 1
    if entries[0].type == CAMERA_INFO:
        assert "no calibration of its own: " in CliRunner().invoke(main, ["info", str(path)]).output


def test_images_that_were_turned_in_rectifying_are_refused(tmp_path):
    entries = info(r=gtsam.Rot3.Yaw(0.01).matrix().ravel()), static(*TREE)
    (tmp_path / "raw").mkdir()
    recorded_camera(open_recording(recorded(tmp_path / "raw", *entries)))
    path = recorded(tmp_path, *entries, images="/cam0/image_rect")
    with pytest.raises(RecordingError, match="R is not the identity"):
        recorded_camera(open_recording(path))


def test_a_topic_of_two_types_is_refused(tmp_path):
    path = recorded(tmp_path, info(), static(*TREE))
    recording = open_recording(path)
    recording.topics.append(Topic("/tf_static", "std_msgs/msg/String", "cdr", 1))
    with pytest.raises(RecordingError, match="must be of type tf2_msgs/msg/TFMessage, but is"):
        recorded_camera(recording)


def test_smooth_takes_it_where_the_imu_is_named(tmp_path):
    path = str(recorded(tmp_path, info(), static(*TREE)))
    result = CliRunner().invoke(main, ["smooth", path])
    assert result.exit_code == 2
    assert "say what IMU it is: --imu d435i, --imu adis16448" in result.output
    result = CliRunner().invoke(main, ["smooth", path, "--imu", "d435i", "--camera", "cam0"])
    assert result.exit_code == 2
    assert "--camera chooses among the cameras of --calibration" in result.output
    result = CliRunner().invoke(main, ["smooth", path, "--imu", "d435i", "--output", f"{path}.out"])
    assert result.exit_code == 3, result.output  # too short for an estimate
    assert "camera_info and /tf_static" in result.output
    result = CliRunner().invoke(main, ["info", path])
    assert "tell of the camera, 20.6 mm from the IMU: smooth needs only --imu" in result.output
