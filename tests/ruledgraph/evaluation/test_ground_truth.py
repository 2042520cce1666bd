# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ruledgraph.core.trajectory import TrajectoryError
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.evaluation.markers import MarkersError, read_markers
from ruledgraph.recording import Recording
from ruledgraph.recording.formats import open_container

DATA = Path(__file__).parents[3] / "../shared/data"
HALF = np.sqrt(0.5)
START = 1403636584663560000
# Two poses: position, quaternion x, y, z, w.
POSES = [([1.0, 2.0, 3.0], [0.0, 0.0, HALF, HALF]), ([1.5, 2.5, 3.5], [0.6, 0.0, 0.0, 0.8])]
STAMPS = [START, START + 5_000_001]


def assert_the_two_poses(truth: GroundTruth, stamps=STAMPS, atol: float = 1e-15) -> None:
    assert truth.stamps.tolist() == list(stamps)
    np.testing.assert_allclose(truth.positions, [p for p, _ in POSES], atol=atol)
    np.testing.assert_allclose(truth.quaternions, [q for _, q in POSES], atol=atol)
    assert (truth.dropped, truth.repeated) == (0, 0)


@pytest.fixture
def file(tmp_path):
    """Writes a text to a new file and returns its path."""

    def write(text: str, name: str = "truth.txt") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def row(separator: str, *values) -> str:
    return separator.join(str(v) for v in values) + "\n"


def tum_rows() -> str:
    stamps = ["1403636584.663560000", "1403636584.668560001"]
    return "".join(row(" ", s, *p, *q) for s, (p, q) in zip(stamps, POSES, strict=True))


def csv_rows(*extra) -> str:
    return "".join(
        row(",", s, *p, q[3], *q[:3], *extra) for s, (p, q) in zip(STAMPS, POSES, strict=True)
    )


# files

EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], "
    "q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
)
NINE = (0.1, 0.2, 0.3, -0.002, 0.02, 0.07, -0.02, 0.13, 0.05)


@pytest.mark.parametrize(
    "text",
    [
        tum_rows(),
        "# timestamp tx ty tz qx qy qz qw\n" + tum_rows(),
        EUROC + ", v_RS_R_x [m s^-1]\n" + csv_rows(*NINE),
        "#time(ns),px,py,pz,qw,qx,qy,qz,vx,vy,vz,bwx,bwy,bwz,bax,bay,baz\n" + csv_rows(*NINE),
        EUROC + "\n" + csv_rows(),
        "timestamp [ns],px,py,pz,qw,qx,qy,qz\n" + csv_rows(),
        csv_rows(),
        csv_rows().replace("\n", ",\r\n"),
        "#timestamp [ns],px,py,pz,qx,qy,qz,qw\n"
        + "".join(row(",", s, *p, *q) for s, (p, q) in zip(STAMPS, POSES, strict=True)),
    ],
    ids=[
        *("tum", "tum with header", "euroc", "euroc short header", "vicon", "header without #"),
        *("no header", "trailing commas", "quaternion order of the header"),
    ],
)
def test_files_with_poses(file, text):
    truth = read_ground_truth(file(text))
    assert_the_two_poses(truth)
    np.testing.assert_array_equal(truth.trajectory.quaternions, truth.quaternions)


def test_positions_alone(file):
    truth = read_ground_truth(
        file("#timestamp [ns], p_RS_R_x [m], y, z\n" + row(",", START, 1.0, 2.0, 3.0))
    )
    assert (truth.stamps.tolist(), truth.positions.tolist()) == ([START], [[1.0, 2.0, 3.0]])
    assert truth.quaternions is None
    with pytest.raises(TrajectoryError, match="positions alone, no orientations"):
        _ = truth.trajectory


KITTI = "0 -1 0 1.0 1 0 0 2.0 0 0 1 3.0\n1 0 0 1.5 0 0.28 -0.96 2.5 0 0.96 0.28 3.5\n"


def test_kitti(file):
    poses, times = file(KITTI, "poses.txt"), file("0.0\n1.036224e-01\n", "times.txt")
    for source in (poses, f"{poses},{times}"):
        assert_the_two_poses(read_ground_truth(source), [0, 103_622_400])
    times.unlink()
    with pytest.raises(TrajectoryError, match=r"KITTI poses need their stamps, and there is no"):
        read_ground_truth(poses)


def test_rows_are_put_in_order_and_cleaned(file):
    lost = [
        row(" ", 1, 0, "nan", 0, 0, 0, 0, 1),
        row(" ", 2, 0, 0, 0, 0, 0, 0, 0),
        row(" ", 3, 0, 0, 0, 0, "inf", 0, 1),
        row(" ", -4, 0, 0, 0, 0, 0, 0, 1),
    ]
    first, second = tum_rows().splitlines(keepends=True)
    truth = read_ground_truth(file(second + "".join(lost) + first + second))
    assert (truth.dropped, truth.repeated) == (4, 1)
    np.testing.assert_array_equal(truth.stamps, STAMPS)
    np.testing.assert_allclose(truth.quaternions, [q for _, q in POSES], atol=1e-15)


@pytest.mark.skipif(not DATA.exists(), reason="needs the recorded EuRoC data")
def test_recorded_files():
    truth = read_ground_truth(DATA / "euroc_motion/MH_04_difficult/groundtruth.csv")
    assert truth.stamps[0] == 1403638128940097024
    np.testing.assert_array_equal(truth.positions[0], [4.677066, -1.749440, 0.568567])
    # Of q and -q the one nearer the identity, to six printed digits.
    wanted = [-0.761130, -0.355916, -0.485843, 0.240749]
    np.testing.assert_allclose(truth.quaternions[0], wanted, atol=1e-6)
    truth = read_ground_truth(DATA / "euroc_motion/V1_01_easy/groundtruth.csv")
    wanted = [-0.824237, -0.106942, -0.551702, 0.069433]
    np.testing.assert_allclose(truth.quaternions[0], wanted, atol=1e-6)
    truth = read_ground_truth(DATA / "euroc_MH_01_30s/MH_01_30s.gt.tum")
    assert truth.stamps[0] == START
    assert truth.repeated == truth.dropped == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": holds no rows of numbers"),
        ("1 2 3\n", ":1: 3 columns; ground truth has 8 (stamp, position, quaternion), 4 without"),
        ("1 0 0 0 0 0 0 1\n2 0 0 0\n", ":2: 4 columns, but 8 in the first row"),
        ("1 0 0 0 0 0 0 3\n", ": quaternion 0 has norm 3, not 1; are the columns in this order?"),
        ("1 0 0 0 0 0 0 0\n", ": holds no valid pose"),
        ("x,y\n14036365846635600001,0,0,0\n", ":2: '14036365846635600001' is no stamp in ns"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(file, text, message):
    path = file(text)
    with pytest.raises(TrajectoryError) as error:
        read_ground_truth(path)
    assert str(error.value).startswith(f"{path}{message}")


def test_what_is_wrong_with_kitti_is_named(file):
    poses, times = file(KITTI.replace("-1", "1"), "poses.txt"), file("0\n1\n", "times.txt")
    with pytest.raises(TrajectoryError, match=r"poses\.txt:1: its first three columns are no rot"):
        read_ground_truth(poses)
    times.write_text("0\n")
    with pytest.raises(TrajectoryError, match=r"times\.txt: 1 stamps, but 2 poses"):
        read_ground_truth(poses)
    with pytest.raises(TrajectoryError, match="2 columns, but KITTI's poses have 12"):
        read_ground_truth(f"{file('1 2')},{times}")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(TrajectoryError, match="cannot be read: No such file"):
        read_ground_truth(tmp_path / "none")
    with pytest.raises(TrajectoryError, match="cannot be read: Is a directory"):
        read_ground_truth(tmp_path)


@pytest.mark.parametrize(
    "text", [tum_rows(), EUROC + "\n" + csv_rows(*NINE), KITTI], ids=["tum", "euroc", "kitti"]
)
def test_damaged_files_give_poses_or_one_line(file, text):
    path = file(text * 3)
    file("\n".join(map(str, range(6))), "times.txt")
    alphabet = np.frombuffer(b"0123456789" * 4 + b".,-+e# \nnaif\xff\0", dtype=np.uint8)
    outcomes = {"read": 0, "refused": 0}
    for seed in range(700):
        rng = np.random.default_rng(seed)
        data = bytearray((text * 3).encode())
        for _ in range(rng.integers(1, 4)):
            at = int(rng.integers(len(data)))
            data[at : at + int(rng.integers(0, 3))] = rng.choice(alphabet, 1).tobytes()
        path.write_bytes(bytes(data))
        try:
            truth = read_ground_truth(path)
        except TrajectoryError as error:
            assert "\n" not in str(error)  # noqa: PT017 - both ends are fine
            outcomes["refused"] += 1
        else:
            assert np.isfinite(truth.positions).all()
            assert np.all(np.diff(truth.stamps) > 0)
            outcomes["read"] += 1
    assert min(outcomes.values()) > 50


# topics

STORE = get_typestore(Stores.ROS1_NOETIC)
for name, definition in {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "vicon_bridge/msg/Marker": "string marker_name\nstring subject_name\nstring segment_name\n"
    "geometry_msgs/Point translation\nbool occluded",
    "vicon_bridge/msg/Markers": "Header header\nuint32 frame_number\nMarker[] markers",
}.items():
    STORE.register(get_types_from_msg(definition, name))
T = STORE.types


def header(stamp: int):
    time = T["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    return T["std_msgs/msg/Header"](0, time, "world")


def pose_message(kind: str, stamp: int, p, q, child: str = "body"):
    point, quaternion = T["geometry_msgs/msg/Point"](*p), T["geometry_msgs/msg/Quaternion"](*q)
    pose = T["geometry_msgs/msg/Pose"](point, quaternion)
    covered = T["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
    if kind == "nav_msgs/msg/Odometry":
        zero = T["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = T["geometry_msgs/msg/Twist"](zero, zero)
        twist = T["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
        return T[kind](header(stamp), child, covered, twist)
    if kind == "geometry_msgs/msg/TransformStamped":
        vector = T["geometry_msgs/msg/Vector3"](*p)
        transform = T["geometry_msgs/msg/Transform"](vector, quaternion)
        return T[kind](header(stamp), child, transform)
    body = {"PoseStamped": pose, "PoseWithCovarianceStamped": covered, "PointStamped": point}
    return T[kind](header(stamp), body[kind.rsplit("/", 1)[1]])


def write_bag(path: Path, topics: dict[str, tuple[str, list]]) -> Recording:
    """A bag whose messages were received a second after their headers' stamps."""
    with Rosbag1Writer(path) as writer:
        for name, (kind, messages) in topics.items():
            connection = writer.add_connection(name, kind, typestore=STORE)
            for i, message in enumerate(messages):
                data = STORE.serialize_ros1(message, kind)
                writer.write(connection, START + 10**9 + i, data)
    return Recording(open_container(path), None, None)


POSE_TYPES = [
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
]


@pytest.mark.parametrize("kind", POSE_TYPES)
def test_topics_with_poses(tmp_path, kind):
    messages = [pose_message(kind, s, *pose) for s, pose in zip(STAMPS, POSES, strict=True)]
    recording = write_bag(tmp_path / "a.bag", {"/vicon/body": (kind, messages)})
    assert_the_two_poses(read_ground_truth("/vicon/body", recording))
    assert_the_two_poses(read_ground_truth("vicon/body", recording))


def test_a_file_comes_before_a_topic(tmp_path, file):
    kind = "geometry_msgs/msg/PoseStamped"
    messages = [pose_message(kind, START, *POSES[0])]
    recording = write_bag(tmp_path / "a.bag", {str(tmp_path): (kind, messages)})
    assert_the_two_poses(read_ground_truth(file(tum_rows()), recording))
    poses, times = file(KITTI, "poses.txt"), file("0.0\n0.1\n", "stamps.txt")
    assert_the_two_poses(read_ground_truth(f"{poses},{times}", recording), [0, 100_000_000])
    # A folder is no ground truth, but a topic may be called the same.
    assert len(read_ground_truth(tmp_path, recording).stamps) == 1


def test_topic_with_points(tmp_path):
    kind = "geometry_msgs/msg/PointStamped"
    messages = [pose_message(kind, s, *pose) for s, pose in zip(STAMPS, POSES, strict=True)]
    truth = read_ground_truth(
        "/leica/position", write_bag(tmp_path / "a.bag", {"/leica/position": (kind, messages)})
    )
    assert truth.quaternions is None
    np.testing.assert_array_equal(truth.positions, [p for p, _ in POSES])
    assert truth.stamps.tolist() == STAMPS


def test_frames_among_transforms(tmp_path):
    kind = "geometry_msgs/msg/TransformStamped"
    messages = [
        T["tf2_msgs/msg/TFMessage"](
            [
                pose_message(kind, stamp, [9.0, 9.0, 9.0], [0, 0, 0, 1], "wand"),
                pose_message(kind, stamp, *pose, "/vicon/body"),
            ]
        )
        for stamp, pose in zip(STAMPS, POSES, strict=True)
    ]
    recording = write_bag(tmp_path / "a.bag", {"/tf": ("tf2_msgs/msg/TFMessage", messages)})
    assert_the_two_poses(read_ground_truth("/tf:vicon/body", recording))
    for source, what in (("/tf", "holds the transforms of frames"), ("/tf:hat", "no frame hat")):
        with pytest.raises(TrajectoryError) as error:
            read_ground_truth(source, recording)
        choices = "/tf:vicon/body  or  /tf:wand"
        assert str(error.value) == f"{source}: {what}, choose one: {choices}"


def test_topics_without_ground_truth(tmp_path):
    kind = "geometry_msgs/msg/PoseStamped"
    topics = {
        "/pose": (kind, [pose_message(kind, START, *POSES[0])]),
        "/time": ("std_msgs/msg/Header", [header(START)]),
    }
    recording = write_bag(tmp_path / "a.bag", topics)
    with pytest.raises(TrajectoryError) as error:
        read_ground_truth("/none", recording)
    assert str(error.value) == "/none: is no file and no topic; topics with ground truth: /pose"
    with pytest.raises(TrajectoryError, match="/time: holds std_msgs/msg/Header, no poses; topics"):
        read_ground_truth("/time", recording)


# markers


def test_markers_in_files(file):
    csv = file("# surveyed\nname, x, y, z\ndoor left,1,2,3.5\ndoor right,2,2,3.5\n", "m.csv")
    yaml = file("door left: [1, 2, 3.5]\ndoor right: [2.0, 2, 3.5]\n", "m.yaml")
    for path in (csv, yaml):
        markers = read_markers(path)
        assert {name: point.tolist() for name, point in markers.items()} == {
            "door left": [1.0, 2.0, 3.5],
            "door right": [2.0, 2.0, 3.5],
        }


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("m.csv", "a,1,2,3\na,1,2,3\n", ":2: a occurs twice"),
        ("m.csv", "a,1,2\n", ":1: not name,x,y,z"),
        ("m.csv", "a,1,2,x\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.csv", "# nothing\n", ": holds no markers"),
        ("m.yaml", "a: 123\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "a: [1, 2, nan]\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "a: [1, {b: 2}, 3]\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "a: [1, [2], 3]\n", ": 'a' must be 3 numbers, x, y, z in metres"),
        ("m.yaml", "just words\n", ": holds no markers"),
        ("m.yaml", "a: [1\n", ":2: not valid YAML: "),
    ],
)
def test_what_is_wrong_with_markers_is_named(file, name, text, message):
    path = file(text, name)
    with pytest.raises(MarkersError) as error:
        read_markers(path)
    assert str(error.value).startswith(f"{path}{message}")


def test_markers_are_means_over_topics(tmp_path):
    kind = "geometry_msgs/msg/PointStamped"

    def points(*xs):
        return kind, [
            pose_message(kind, START + i, [x, 1.0, 2.0], [0] * 4) for i, x in enumerate(xs)
        ]

    topics = {"/m/one": points(1.0, 2.0, np.nan), "/m/two": points(5.0), "/other": points(7.0)}
    recording = write_bag(tmp_path / "a.bag", topics)
    markers = read_markers("/m/*", recording)
    assert {name: point.tolist() for name, point in markers.items()} == {
        "m/one": [1.5, 1.0, 2.0],
        "m/two": [5.0, 1.0, 2.0],
    }
    with pytest.raises(MarkersError) as error:
        read_markers("/none*", recording)
    names = "/m/one, /m/two, /other"
    assert str(error.value) == f"/none*: no markers there; topics with positions: {names}"


@pytest.mark.parametrize("scale", [1.0, 1000.0], ids=["metres", "millimetres"])
def test_markers_of_a_vicon(scale):
    def marker(name, x, occluded=False, subject="wand"):
        translation = SimpleNamespace(x=x * scale, y=2.0 * scale, z=3.0 * scale)
        return SimpleNamespace(
            marker_name=name, subject_name=subject, translation=translation, occluded=occluded
        )

    messages = [
        SimpleNamespace(markers=[marker("a", 1.0), marker("b", 9.0, occluded=True)]),
        SimpleNamespace(markers=[marker("a", 2.0), marker("", 8.0), marker("c", 4.0, subject="")]),
    ]
    recording = SimpleNamespace(
        topics=[SimpleNamespace(name="/vicon/markers", type="vicon_bridge/msg/Markers")],
        messages=lambda _: ((0, message) for message in messages),
    )
    markers = read_markers("/vicon/markers", recording)
    assert markers.keys() == {"wand/a", "c"}
    np.testing.assert_allclose(markers["wand/a"], [1.5, 2.0, 3.0])
    np.testing.assert_allclose(markers["c"], [4.0, 2.0, 3.0])


def test_vicon_markers_of_a_bag(tmp_path):
    kinds = {name: STORE.types[f"vicon_bridge/msg/{name}"] for name in ("Marker", "Markers")}
    point, header = STORE.types["geometry_msgs/msg/Point"], STORE.types["std_msgs/msg/Header"]
    time = STORE.types["builtin_interfaces/msg/Time"]
    messages = [
        kinds["Markers"](
            header=header(seq=i, stamp=time(sec=1, nanosec=i), frame_id="vicon"),
            frame_number=i,
            markers=[
                kinds["Marker"]("corner", "board", "", point(1000.0 + i, 2000.0, 3000.0), False),
                kinds["Marker"]("hidden", "board", "", point(0.0, 0.0, 0.0), True),
            ],
        )
        for i in (0, 2)
    ]
    bag = write_bag(tmp_path / "a.bag", {"/vicon/markers": ("vicon_bridge/msg/Markers", messages)})
    markers = read_markers("/vicon/markers", bag)
    assert list(markers) == ["board/corner"]
    np.testing.assert_allclose(markers["board/corner"], [1.001, 2.0, 3.0])
