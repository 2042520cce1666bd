# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A run's results in other tools' formats, read back."""

import csv
from collections import defaultdict
from pathlib import Path

import gtsam
import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ruledgraph.app.cli import main
from ruledgraph.app.line_files import write_obj, write_ply
from ruledgraph.app.ros_output import ros_covariances
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.trajectory import read_tum
from ruledgraph.evaluation.sources import read_line_ends, read_poses
from small_simulation import small_stream, write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("outputs")


@pytest.fixture(scope="module")
def outputs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("outputs")
    write_small_recording(folder)
    arguments = [
        *("smooth", folder / "small.bag", "--calibration", folder / "calib.yaml"),
        *("--output", folder / "run", "--ros2-bag", folder / "odom.mcap"),
        *("--trajectory-format", "kitti", "--trajectory-format", "euroc"),
        *("--set", "map.spacing=0"),  # lines come one sighting each
    ]
    result = CliRunner().invoke(main, list(map(str, arguments)))
    assert result.exit_code == 0, result.output
    assert f"for RViz and Foxglove: {folder / 'odom.mcap'}" in result.output
    return folder


@pytest.fixture(scope="module")
def messages(outputs) -> dict[str, list]:
    """By topic: time and message."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    found = defaultdict(list)
    # A bag's metadata stands beside its file; without, the file is read alone.
    with AnyReader([outputs / "odom.mcap"], default_typestore=store) as reader:
        for connection, time, data in reader.messages():
            found[connection.topic].append((time, reader.deserialize(data, connection.msgtype)))
    return found


def stamp(header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def xyz(v) -> list[float]:
    return [v.x, v.y, v.z]


@pytest.mark.parametrize("name", ["trajectory", "trajectory_live"])
def test_other_formats_hold_the_same_poses(outputs, name):
    expected = read_tum(outputs / "run" / f"{name}.tum")
    base = outputs / "run" / name
    for source in (f"{base}_kitti.txt,{base}_kitti_times.txt", f"{base}_euroc.csv"):
        found = read_poses(source)
        np.testing.assert_array_equal(found.stamps, expected.stamps)
        np.testing.assert_array_equal(found.positions, expected.positions)
        # Quaternions come from matrices in between.
        np.testing.assert_allclose(found.quaternions, expected.quaternions, atol=1e-12)


def test_eurocs_format_holds_velocity_and_biases(outputs):
    with (outputs / "run" / "trajectory_live_euroc.csv").open() as file:
        rows = {row[0]: row for row in csv.reader(file)}
    with (outputs / "run" / "states.csv").open() as file:
        states = list(csv.DictReader(file))
    for state in states:
        row = rows[state["stamp"].replace(".", "")]
        names = ("velocity", "gyroscope_bias", "accelerometer_bias")
        expected = [float(state[f"{name}_{axis}"]) for name in names for axis in "xyz"]
        np.testing.assert_allclose(list(map(float, row[8:])), expected, rtol=1e-8)


def test_odometry_messages_are_the_live_trajectory(outputs, messages):
    expected = read_tum(outputs / "run" / "trajectory_live.tum")
    found = messages["/odometry"]
    assert [stamp(m.header) for _, m in found] == list(expected.stamps)
    assert [time for time, _ in found] == list(expected.stamps)
    assert {(m.header.frame_id, m.child_frame_id) for _, m in found} == {("world", "body")}
    positions = [xyz(m.pose.pose.position) for _, m in found]
    np.testing.assert_array_equal(positions, expected.positions)
    for _, m in found:
        covariance = m.pose.covariance.reshape(6, 6)
        assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
        # As live positions move, up to the small part that a bias feigns.
    velocity = np.array([xyz(m.twist.twist.linear) for _, m in found])
    moved = np.diff(expected.positions, axis=0) / np.diff(expected.stamps)[:, None] * 1e9
    speed = np.linalg.norm(moved, axis=1)
    # Between frames the speed of the simulated walk changes by some cm/s; where a state is solved
    # the position is corrected, too.
    off = np.abs(np.linalg.norm(velocity[1:], axis=1) - speed)
    assert np.quantile(off, 0.9) < 0.1


def test_transforms_are_the_same_poses(messages):
    for (_, odometry), (_, tf) in zip(messages["/odometry"], messages["/tf"], strict=True):
        (transform,) = tf.transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("world", "body")
        assert transform.header.stamp == odometry.header.stamp
        assert transform.transform.rotation == odometry.pose.pose.orientation
        assert xyz(transform.transform.translation) == xyz(odometry.pose.pose.position)
    ((_, static),) = messages["/tf_static"]
    mounting = small_stream()[1].body_T_cam
    assert static.transforms[0].child_frame_id == "cam0"
    assert xyz(static.transforms[0].transform.translation) == list(mounting.translation())


def test_the_path_is_the_smoothed_trajectory(outputs, messages):
    expected = read_tum(outputs / "run" / "trajectory.tum")
    ((_, path),) = messages["/path"]
    assert [stamp(pose.header) for pose in path.poses] == list(expected.stamps)
    positions = [xyz(pose.pose.position) for pose in path.poses]
    np.testing.assert_array_equal(positions, expected.positions)


def test_markers_are_the_lines(outputs, messages):
    markers = [marker for _, array in messages["/lines"] for marker in array.markers]
    ends = [[xyz(point) for point in marker.points] for marker in markers]
    expected = read_line_ends(outputs / "run")
    assert len(expected) > 5
    # The table is in order of the first sightings, the messages in that of the last ones.
    np.testing.assert_allclose(sorted(ends), sorted(expected.tolist()), rtol=1e-8)
    assert {(m.header.frame_id, m.type, m.action) for m in markers} == {("world", 5, 0)}


def test_line_files_of_a_run(outputs):
    ends = read_line_ends(outputs / "run")
    for suffix in ("ply", "obj"):
        lines = (outputs / "run" / f"lines.{suffix}").read_text().splitlines()
        assert len([line for line in lines if line.startswith("l ")]) in (0, len(ends))
        assert "nan" not in lines


def test_line_files_of_known_segments(tmp_path):
    ends = np.array([[[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]], [[0.0, 2.0, 0.0], [0.0, 2.0, -3.25]]])
    write_ply(tmp_path / "lines.ply", ends)
    text = (tmp_path / "lines.ply").read_text()
    head, body = text.split("end_header\n")
    assert head.startswith("ply\nformat ascii 1.0\nelement vertex 4\n")
    assert "element edge 2\n" in head
    assert body == "0 0 0\n1.5 0 0\n0 2 0\n0 2 -3.25\n0 1\n2 3\n"
    write_obj(tmp_path / "lines.obj", ends)
    text = (tmp_path / "lines.obj").read_text()
    assert text == "v 0 0 0\nv 1.5 0 0\nv 0 2 0\nv 0 2 -3.25\nl 1 2\nl 3 4\n"


def test_ros_covariances_are_those_of_drawn_states():
    rng = np.random.default_rng(5)
    roots = [1e-3 * rng.normal(size=(n, n)) for n in (6, 3, 6)]
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.4, -1.1, 2.0), np.array([1.0, -2.0, 0.5]))
    estimate = Estimate(
        stamp=1,
        world_T_body=pose,
        velocity=np.array([1.0, -0.5, 2.0]),
        bias=gtsam.imuBias.ConstantBias(),
        covariances=tuple(root @ root.T for root in roots),
        lines=0,
        status="tracking",
        at_state=True,
    )
    count = 20_000
    tangents = rng.normal(size=(count, 6)) @ roots[0].T
    velocities = estimate.velocity + rng.normal(size=(count, 3)) @ roots[1].T
    drawn, twists = np.empty((count, 6)), np.empty((count, 3))
    for i, (tangent, velocity) in enumerate(zip(tangents, velocities, strict=True)):
        moved = pose.retract(tangent)
        # ROS: position, then the rotation about the fixed axes of the world.
        drawn[i, :3] = moved.translation() - pose.translation()
        drawn[i, 3:] = gtsam.Rot3.Logmap(moved.rotation().compose(pose.rotation().inverse()))
        twists[i] = moved.rotation().unrotate(velocity)
    of_pose, of_twist = ros_covariances(estimate)
    # Standard deviation of a sample covariance of 20,000: 1 % of its size; five of them.
    for sample, expected in ((np.cov(drawn.T), of_pose), (np.cov(twists.T), of_twist[:3, :3])):
        sigmas = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            sample / np.outer(sigmas, sigmas), expected / np.outer(sigmas, sigmas), atol=0.05
        )


@pytest.mark.parametrize(
    ("bag", "message"), [("odom.bag", "name it *.mcap"), ("taken.mcap", "exists already")]
)
def test_a_bag_that_cannot_be_written(outputs, tmp_path, bag, message):
    (tmp_path / "taken.mcap").write_text("mine")
    arguments = [outputs / "small.bag", "--calibration", outputs / "calib.yaml"]
    arguments += ["--output", tmp_path / "run", "--ros2-bag", tmp_path / bag]
    result = CliRunner().invoke(main, ["smooth", *map(str, arguments)])
    assert result.exit_code == 2
    assert message in result.output
    assert not (tmp_path / "run").exists()
