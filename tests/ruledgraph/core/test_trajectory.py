# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ruledgraph.core.trajectory import Trajectory, TrajectoryError, TumWriter, read_tum

EUROC = Path(__file__).parents[3] / "../shared/data/euroc_MH_01_30s/MH_01_30s.gt.tum"
START = 1403636584663560000
HALF = np.sqrt(0.5)


def random_trajectory(n: int = 50, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    stamps = START + np.cumsum(rng.integers(1, 10**8, n))
    return Trajectory(stamps, rng.normal(size=(n, 3)) * 10, Rotation.random(n, rng).as_quat())


def assert_equal(a: Trajectory, b: Trajectory) -> None:
    np.testing.assert_array_equal(a.stamps, b.stamps)
    np.testing.assert_array_equal(a.positions, b.positions)
    np.testing.assert_array_equal(a.quaternions, b.quaternions)


def read_text(tmp_path: Path, text: str) -> Trajectory:
    path = tmp_path / "trajectory.tum"
    path.write_text(text, encoding="utf-8")
    return read_tum(path)


# in memory


def test_quaternions_become_unit_and_continuous():
    q = np.array([[0, 0, 0, 1.0], [0, 0, -0.1, -1.0], [0, 0, 0.2, 1.0]])
    trajectory = Trajectory(np.arange(3), np.zeros((3, 3)), q)
    wanted = q * [[1], [-1], [1]] / np.linalg.norm(q, axis=1, keepdims=True)
    np.testing.assert_allclose(trajectory.quaternions, wanted, atol=1e-15)
    assert len(trajectory) == 3


def test_poses_and_back():
    trajectory = random_trajectory()
    poses = trajectory.poses()
    np.testing.assert_allclose(
        poses[7].rotation().matrix(),
        Rotation.from_quat(trajectory.quaternions[7]).as_matrix(),
        atol=1e-14,
    )
    back = Trajectory.from_poses(trajectory.stamps, poses)
    np.testing.assert_array_equal(back.positions, trajectory.positions)
    np.testing.assert_allclose(back.quaternions, trajectory.quaternions, atol=1e-14)


def test_halfway_between_two_poses():
    # A quarter turn about z, half done at the middle.
    trajectory = Trajectory(
        START + np.array([0, 2_000_000_000]),
        np.array([[0.0, 0.0, 0.0], [2.0, 4.0, -6.0]]),
        np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -HALF, -HALF]]),
    )
    middle = trajectory.at([START + 500_000_000, START + 1_000_000_000])
    np.testing.assert_allclose(middle.positions, [[0.5, 1.0, -1.5], [1.0, 2.0, -3.0]], atol=1e-15)
    angles = np.pi / 16, np.pi / 8
    wanted = [[0.0, 0.0, np.sin(a), np.cos(a)] for a in angles]
    np.testing.assert_allclose(middle.quaternions, wanted, atol=1e-15)


def test_interpolation_at_the_stamps_returns_the_poses():
    trajectory = random_trajectory()
    same = trajectory.at(trajectory.stamps)
    np.testing.assert_array_equal(same.positions, trajectory.positions)
    dot = np.abs(np.sum(same.quaternions * trajectory.quaternions, axis=1))
    np.testing.assert_allclose(dot, 1.0, atol=1e-14)
    one = Trajectory(trajectory.stamps[:1], trajectory.positions[:1], trajectory.quaternions[:1])
    assert_equal(one.at(one.stamps), one)


def test_interpolation_stays_inside():
    trajectory = Trajectory([START, START + 1], np.zeros((2, 3)), [[0, 0, 0, 1.0]] * 2)
    with pytest.raises(TrajectoryError) as error:
        trajectory.at([START + 2])
    assert str(error.value) == (
        "stamp 1403636584.663560002 is outside the trajectory, "
        "1403636584.663560000 to 1403636584.663560001"
    )


@pytest.mark.parametrize(
    ("stamps", "positions", "quaternions", "message"),
    [
        ([], np.zeros((0, 3)), np.zeros((0, 4)), "must have poses"),
        ([1], np.zeros((1, 2)), [[0, 0, 0, 1]], r"not \(1,\), \(1, 2\), \(1, 4\)"),
        ([1, 1], np.zeros((2, 3)), [[0, 0, 0, 1]] * 2, "stamps must increase strictly"),
        ([-1], np.zeros((1, 3)), [[0, 0, 0, 1]], "from 0 on"),
        ([1], np.full((1, 3), np.nan), [[0, 0, 0, 1]], "must be finite"),
        ([1], np.zeros((1, 3)), [[0, 0, 0, 0]], "quaternion 0 has norm 0, not 1"),
    ],
)
def test_wrong_arrays_are_named(stamps, positions, quaternions, message):
    with pytest.raises(TrajectoryError, match=message):
        Trajectory(stamps, positions, quaternions)


# TUM files


def test_tum_is_read_exactly(tmp_path):
    text = (
        "# stamp x y z q\n1403636584.663560000 1 -2.5 3e-1 0 0 0 1\n1403636584.7 1 2 3 0 0 0 -1\n"
    )
    trajectory = read_text(tmp_path, text)
    assert trajectory.stamps.tolist() == [1403636584663560000, 1403636584700000000]
    np.testing.assert_array_equal(trajectory.positions, [[1, -2.5, 0.3], [1, 2, 3]])
    np.testing.assert_array_equal(trajectory.quaternions, [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("0", 0),
        ("1.000000001", 1_000_000_001),
        (".5", 500_000_000),
        ("1.40363658466356e+09", START),
        ("9223372036.854775807", 2**63 - 1),
    ],
)
def test_stamps_keep_every_digit(tmp_path, text, stamp):
    assert read_text(tmp_path, f"{text} 0 0 0 0 0 0 1").stamps[0] == stamp


def test_what_is_written_reads_back_identically(tmp_path):
    for seed in range(5):
        trajectory = random_trajectory(seed=seed)
        trajectory.write_tum(tmp_path / f"{seed}.tum")
        assert_equal(read_tum(tmp_path / f"{seed}.tum"), trajectory)


def test_evo_reads_the_same_numbers(tmp_path):
    from evo.tools import file_interface

    trajectory = random_trajectory()
    trajectory.write_tum(tmp_path / "a.tum")
    read = file_interface.read_tum_trajectory_file(str(tmp_path / "a.tum"))
    np.testing.assert_array_equal(read.positions_xyz, trajectory.positions)
    xyzw = np.roll(read.orientations_quat_wxyz, -1, axis=1)
    np.testing.assert_array_equal(xyzw, trajectory.quaternions)
    # evo keeps stamps in float64 seconds: the nearest to the exact ones.
    wanted = [float(f"{s // 10**9}.{s % 10**9:09d}") for s in trajectory.stamps.tolist()]
    assert read.timestamps.tolist() == wanted


@pytest.mark.skipif(not EUROC.exists(), reason="needs the recorded EuRoC ground truth")
def test_recorded_ground_truth_survives_a_round_trip(tmp_path):
    recorded = read_tum(EUROC)
    lines = EUROC.read_text().splitlines()
    assert recorded.stamps[0] == START
    np.testing.assert_array_equal(recorded.positions[0], [4.678424, -1.760459, 0.986156])
    recorded.write_tum(tmp_path / "again.tum")
    again = (tmp_path / "again.tum").read_text().splitlines()
    assert [line.split()[0] for line in again] == [line.split()[0] for line in lines]


def test_writer_keeps_what_it_was_given_so_far(tmp_path):
    path = tmp_path / "live.tum"
    writer = TumWriter(path)
    writer.append(5, gtsam.Pose3(gtsam.Rot3.Rz(np.pi / 2), np.array([1.0, 2.0, 1e-7])))
    fields = path.read_text().split()
    assert fields[:4] == ["0.000000005", "1.0", "2.0", "1e-07"]
    np.testing.assert_allclose([float(x) for x in fields[4:]], [0, 0, HALF, HALF], atol=1e-15)
    with pytest.raises(TrajectoryError, match=r"stamp 0\.000000005 is not after 0\.000000005"):
        writer.append(5, gtsam.Pose3())
    writer.close()
    assert len(read_tum(path)) == 1


def test_writing_does_not_replace_a_file(tmp_path):
    path = tmp_path / "a.tum"
    path.write_text("mine")
    with pytest.raises(TrajectoryError) as error:
        random_trajectory().write_tum(path)
    assert str(error.value) == f"{path}: exists already, choose another name"
    assert path.read_text() == "mine"
    with pytest.raises(TrajectoryError, match="cannot be written: No such file"):
        TumWriter(tmp_path / "no" / "a.tum")


ROW = "1.5 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": holds no rows of numbers"),
        ("# only words\n", ": holds no rows of numbers"),
        ("1 2 3\n", ":1: 3 columns, but TUM has 8: stamp x y z qx qy qz qw"),
        (ROW + "2 0 0 0\n", ":2: 4 columns, but 8 in the first row"),
        (ROW + "2 0 0 zero 0 0 0 1\n", ":2: could not convert string to float: 'zero'"),
        (ROW + "2e 0 0 0 0 0 0 1\n", ":2: '2e' is no stamp in s"),
        ("1403636584663560000 0 0 0 0 0 0 1\n", ":1: '1403636584663560000' is no stamp in s"),
        (ROW + "1e999999999999 0 0 0 0 0 0 1\n", ":2: '1e999999999999' is no stamp in s"),
        (ROW + "nan 0 0 0 0 0 0 1\n", ":2: 'nan' is no stamp in s"),
        (ROW + ROW, ": stamps must increase strictly, from 0 on"),
        ("1 0 0 0 0 0 0 5\n", ": quaternion 0 has norm 5, not 1; are the columns in this order?"),
        ("1 0 nan 0 0 0 0 1\n", ": positions and quaternions must be finite"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(tmp_path, text, message):
    with pytest.raises(TrajectoryError) as error:
        read_text(tmp_path, text)
    assert str(error.value) == f"{tmp_path / 'trajectory.tum'}{message}"


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(TrajectoryError, match=r"none\.tum: cannot be read: No such file"):
        read_tum(tmp_path / "none.tum")
    (tmp_path / "a.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TrajectoryError, match=r"a\.tum: not a text file"):
        read_tum(tmp_path / "a.tum")
