# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Ground truth read from files: TUM, EuRoC, Vicon, KITTI; damaged and wrong ones."""

from pathlib import Path

import numpy as np
import pytest

from ruledgraph.core.trajectory import TrajectoryError
from ruledgraph.evaluation.ground_truth import read_ground_truth
from truth_bags import POSES, STAMPS, START, assert_the_two_poses, pose_message, write_bag

DATA = Path(__file__).parents[3] / "../shared/data"


def row(separator: str, *values) -> str:
    return separator.join(str(v) for v in values) + "\n"


def tum_rows() -> str:
    stamps = ["1403636584.663560000", "1403636584.668560001"]
    return "".join(row(" ", s, *p, *q) for s, (p, q) in zip(stamps, POSES, strict=True))


def csv_rows(*extra) -> str:
    return "".join(
        row(",", s, *p, q[3], *q[:3], *extra) for s, (p, q) in zip(STAMPS, POSES, strict=True)
    )


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


def test_a_file_comes_before_a_topic(tmp_path, file):
    kind = "geometry_msgs/msg/PoseStamped"
    messages = [pose_message(kind, START, *POSES[0])]
    recording = write_bag(tmp_path / "a.bag", {str(tmp_path): (kind, messages)})
    assert_the_two_poses(read_ground_truth(file(tum_rows()), recording))
    poses, times = file(KITTI, "poses.txt"), file("0.0\n0.1\n", "stamps.txt")
    assert_the_two_poses(read_ground_truth(f"{poses},{times}", recording), [0, 100_000_000])
    # A folder is no ground truth, but a topic may be called the same.
    assert len(read_ground_truth(tmp_path, recording).stamps) == 1
