# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is written can be read again, by this package and by others."""

from pathlib import Path

import gtsam
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from recordings import MS, T0, assert_same, sequence, texture
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.measurements import Frame, Gap, ImuSample
from ruledgraph.recording import (
    GroundTruthPose,
    Kind,
    RecordingError,
    open_recording,
    write_recording,
)

KINDS: list[Kind] = ["rosbag1", "rosbag2", "mcap", "asl"]
CAMERA = CameraModel(16, 12, 10.0, 11.0, 7.5, 5.5, "radtan", (0.1, -0.2, 0.003, -2e-5))
POSE = gtsam.Pose3(gtsam.Rot3.Ypr(0.1, 0.2, 0.3), np.array([0.1, -0.2, 0.3]))
CALIBRATION = Calibration(CAMERA, POSE, ADIS16448_LIKE)
TRUTH = [
    GroundTruthPose(T0 + i * 10 * MS, np.array([0.1 * i, 1 / 3, -2.0]), np.array([0, 0, 0.6, 0.8]))
    for i in range(20)
]


@pytest.mark.parametrize("kind", KINDS)
def test_round_trip(kind: Kind, tmp_path: Path) -> None:
    measurements = sequence()
    # Gaps are told by the missing samples.
    gap = Gap(measurements[3][0], measurements[4][0])
    write_recording([*measurements[:4], gap, *measurements[4:]], tmp_path / "a b", kind)
    recording = open_recording(tmp_path / "a b")
    assert recording.kind == kind
    assert_same(list(recording.stream()), measurements)
    # Nothing else is left behind.
    assert [path.name for path in tmp_path.iterdir()] == ["a b"]


@pytest.mark.parametrize("kind", KINDS)
def test_what_exists_is_not_overwritten(kind: Kind, tmp_path: Path) -> None:
    out = tmp_path / "mine"
    out.write_text("precious")
    with pytest.raises(RecordingError, match="mine exists already; remove it or choose another"):
        write_recording(sequence(), out, kind)
    assert out.read_text() == "precious"


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_that_fails_leaves_nothing(kind: Kind, tmp_path: Path) -> None:
    def failing():  # type: ignore[no-untyped-def]
        yield from sequence()[:20]
        raise RuntimeError("out of film")

    with pytest.raises(RuntimeError, match="out of film"):
        write_recording(failing(), tmp_path / "new" / "a", kind)
    assert list((tmp_path / "new").iterdir()) == []


@pytest.mark.parametrize("kind", ["rosbag1", "rosbag2", "mcap"])
def test_bags_as_others_see_them(kind: Kind, tmp_path: Path) -> None:
    name = {"rosbag1": "a.bag", "mcap": "a.mcap"}.get(kind, "a")
    write_recording(
        sequence(),
        tmp_path / name,
        kind,
        calibration=CALIBRATION,
        image_topic="/front/image_raw",
        imu_topic="/body/imu",
        ground_truth=iter(TRUTH),
    )
    with AnyReader([tmp_path / name]) as reader:
        counts = {topic: (info.msgtype, info.msgcount) for topic, info in reader.topics.items()}
        assert counts == {
            "/front/image_raw": ("sensor_msgs/msg/Image", 10),
            "/front/camera_info": ("sensor_msgs/msg/CameraInfo", 1),
            "/tf_static": ("tf2_msgs/msg/TFMessage", 1),
            "/body/imu": ("sensor_msgs/msg/Imu", 100),
            "/ground_truth": ("geometry_msgs/msg/PoseStamped", 20),
        }
        received = [stamp for _, stamp, _ in reader.messages()]
        assert received == sorted(received)
        by_topic = {
            c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()
        }
    pose = by_topic["/ground_truth"].pose  # type: ignore[attr-defined]
    assert (pose.position.x, pose.position.y, pose.position.z) == tuple(TRUTH[-1].position)
    assert (pose.orientation.z, pose.orientation.w) == (0.6, 0.8)
    info = by_topic["/front/camera_info"]
    k, d = (info.K, info.D) if kind == "rosbag1" else (info.k, info.d)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(k, [10.0, 0, 7.5, 0, 11.0, 5.5, 0, 0, 1])
    np.testing.assert_array_equal(d, [*CAMERA.coefficients, 0.0])
    assert info.distortion_model == "plumb_bob"  # type: ignore[attr-defined]
    (transform,) = by_topic["/tf_static"].transforms  # type: ignore[attr-defined]
    assert (transform.header.frame_id, transform.child_frame_id) == ("imu0", "cam0")
    stamps = [stamp for stamp, _ in open_recording(tmp_path / name).messages("/ground_truth")]
    assert stamps == [pose.stamp for pose in TRUTH]


def test_asl_calibration_and_ground_truth(tmp_path: Path) -> None:
    out = tmp_path / "flight"
    write_recording(sequence(), out, "asl", calibration=CALIBRATION, ground_truth=TRUTH)
    yaml = YAML(typ="safe")
    yaml.version = (1, 1)  # type: ignore[assignment]
    text = (out / "mav0/cam0/sensor.yaml").read_text().replace("%YAML:1.0\n", "")
    camera = yaml.load(text)
    assert camera["resolution"] == [16, 12]
    assert camera["intrinsics"] == [10.0, 11.0, 7.5, 5.5]
    assert camera["distortion_model"] == "radial-tangential"
    assert camera["distortion_coefficients"] == list(CAMERA.coefficients)
    assert camera["rate_hz"] == pytest.approx(10.0)
    np.testing.assert_array_equal(np.reshape(camera["T_BS"]["data"], (4, 4)), POSE.matrix())
    imu = yaml.load((out / "mav0/imu0/sensor.yaml").read_text().replace("%YAML:1.0\n", ""))
    assert imu["gyroscope_random_walk"] == ADIS16448_LIKE.gyroscope_walk
    assert imu["rate_hz"] == pytest.approx(100.0)
    rows = (out / "mav0/state_groundtruth_estimate0/data.csv").read_text().splitlines()
    assert rows[0].startswith("#timestamp,p_RS_R_x [m]")
    stamp, *numbers = rows[2].split(",")
    assert int(stamp) == TRUTH[1].stamp
    # Position, then the quaternion w first.
    assert [float(number) for number in numbers] == [0.1, 1 / 3, -2.0, 0.8, 0.0, 0.0, 0.6]


def test_numbers_that_need_every_digit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    measurements = [
        ImuSample(
            T0 + 2 * i, rng.normal(size=3) * 10.0 ** rng.integers(-300, 5), rng.normal(size=3)
        )
        for i in range(200)
    ]
    measurements[101:101] = [Frame(T0 + 201, texture(0))]  # type: ignore[list-item]
    write_recording(measurements, tmp_path / "a", "asl")
    assert_same(list(open_recording(tmp_path / "a").stream()), measurements)


@pytest.mark.parametrize("kind", KINDS)
def test_of_equal_stamps_the_imu_comes_first(kind: Kind, tmp_path: Path) -> None:
    samples = [m for m in sequence() if isinstance(m, ImuSample)]
    frames = [Frame(m.stamp, texture(i)) for i, m in enumerate(samples) if i % 10 == 3]
    expected = sorted([*samples, *frames], key=lambda m: (m.stamp, isinstance(m, Frame)))
    write_recording(sorted([*frames, *samples], key=lambda m: m.stamp), tmp_path / "a", kind)
    assert_same(list(open_recording(tmp_path / "a").stream()), expected)


def test_paths_that_sqlite_would_read_otherwise(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be written to paths with any of"):
        write_recording(sequence(), tmp_path / "run#3", "rosbag2")
    assert list(tmp_path.iterdir()) == []
    for kind in ("rosbag1", "mcap", "asl"):
        write_recording(sequence(), tmp_path / f"run #3 50% {kind}?", kind)
        assert_same(list(open_recording(tmp_path / f"run #3 50% {kind}?").stream()), sequence())
