# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The paper's solver on a rendered recording, and as `ruledgraph smooth --solver paper`."""

import json
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from ruledgraph.app.cli import main
from ruledgraph.baselines.paper import PaperOdometry
from ruledgraph.baselines.paper.start import PointDetector
from ruledgraph.calibration import write_kalibr
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import axis_differences
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.recording import write_recording
from ruledgraph.simulation import Simulation, simulate

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("paper odometry")


@cache
def recording(motion: str = "linear-parallel") -> tuple[Simulation, tuple[Measurement, ...]]:
    """140 frames of window and as many that it slides over, at a third of the paper's rate."""
    simulation = simulate("square", motion, rate=30.0, duration=6.0)
    return simulation, tuple(simulation.stream())


def truth(simulation: Simulation) -> GroundTruth:
    true = simulation.ground_truth
    quaternions = Rotation.from_matrix(true.rotation).as_quat()
    return GroundTruth(true.stamps, true.position, quaternions)


@pytest.fixture(scope="module")
def odometry() -> PaperOdometry:
    """After the whole recording, nothing taken out yet."""
    simulation, stream = recording()
    odometry = PaperOdometry(simulation.calibration)
    for measurement in stream:
        odometry.add(measurement)
    odometry.finish()
    return odometry


@pytest.fixture(scope="module")
def estimates(odometry) -> dict[str, list[Estimate]]:
    return {"live": odometry.take_live(), "smoothed": odometry.take_smoothed()}


@pytest.mark.parametrize("kind", ["live", "smoothed"])
def test_it_stays_within_the_papers_printed_error(estimates, kind):
    """Table 1, linear parallel: the root mean square of mean and deviation, by axis."""
    simulation, stream = recording()
    found = estimates[kind]
    assert [e.stamp for e in found] == [m.stamp for m in stream if isinstance(m, Frame)]
    trajectory = Trajectory.from_poses([e.stamp for e in found], [e.world_T_body for e in found])
    axes = axis_differences(trajectory, truth(simulation), simulation.calibration.body_T_cam)
    printed = np.hypot([0.0019, 0.0138, 0.0251], [0.0080, 0.0215, 0.0173])
    assert np.all(np.hypot(axes.mean, axes.std) < 1.5 * printed)


def test_velocities_are_those_of_the_body(estimates):
    simulation, _ = recording()
    smoothed = estimates["smoothed"]
    true = simulation.truth([e.stamp for e in smoothed])
    errors = [
        np.linalg.norm(e.velocity) - np.linalg.norm(v)
        for e, v in zip(smoothed, true.velocity, strict=True)
    ]
    assert np.sqrt(np.mean(np.square(errors))) < 0.05


def test_the_hough_transform_finds_the_four_slats():
    simulation, stream = recording()
    frame = next(m for m in stream if isinstance(m, Frame))
    ends = PointDetector(simulation.calibration.camera).lines(frame.image, 4)
    along = np.abs(ends[:, 1] - ends[:, 0])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert sorted(np.argmax(along, axis=1)) == [0, 0, 1, 1]
    assert np.all(along.max(axis=1) > 0.999)


def test_rulings_across_the_motion_come_to_lie_on_their_slats(odometry, estimates):
    simulation, _ = recording()
    last = odometry.take_rulings()[-1]
    first = estimates["smoothed"][0]
    true = simulation.truth([first.stamp])
    estimated = first.world_T_body
    upright = [ends for ends in last.ends if abs(ends[1, 2] - ends[0, 2]) > 0.9]
    assert len(upright) == 2
    slats = simulation.lines[np.abs(np.diff(simulation.lines[..., 2])[:, 0]) > 0.5]
    for ends in upright:
        in_body = estimated.transformTo(ends.T)
        in_world = true.rotation[0] @ in_body + true.position[0][:, None]
        direction = in_world[:, 1] - in_world[:, 0]
        offsets = slats[:, 0] - in_world[:, 0]
        distances = np.linalg.norm(np.cross(offsets, direction), axis=1)
        assert distances.min() < 0.05
    lines = odometry.take_lines()
    assert len(lines) == 4
    assert odometry.take_lines() == []


def test_a_gap_ends_the_trajectory():
    simulation, stream = recording()
    odometry = PaperOdometry(simulation.calibration)
    for measurement in stream[:200]:
        odometry.add(measurement)
    stamp = stream[200].stamp
    odometry.add(Gap(stamp, stamp + 10**9))
    count = len(odometry.take_smoothed())
    for measurement in stream[200:250]:
        odometry.add(measurement)
    assert count > 10
    assert odometry.take_smoothed() == []
    assert "the trajectory ends there" in odometry.warnings[-1]


def test_without_lines_it_says_so():
    simulation, stream = recording()
    odometry = PaperOdometry(simulation.calibration)
    for m in stream[:200]:
        odometry.add(m if isinstance(m, ImuSample) else Frame(m.stamp, np.zeros_like(m.image)))
    odometry.finish()
    assert odometry.take_smoothed() == []
    assert "0 lines by the Hough transform" in odometry.warnings[0]


def test_smooth_takes_it_as_its_solver(tmp_path):
    simulation, stream = recording()
    write_recording(stream[:250], tmp_path / "small.bag", "rosbag1")
    write_kalibr(simulation.calibration, tmp_path / "calib.yaml")
    arguments = ["smooth", str(tmp_path / "small.bag"), "--solver", "paper", "--output"]
    arguments += [str(tmp_path / "out"), "--calibration", str(tmp_path / "calib.yaml")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["frames_estimated"] > 20
    assert (tmp_path / "out" / "trajectory.tum").stat().st_size > 0
    refused = CliRunner().invoke(main, [*arguments, "--plots"])
    assert refused.exit_code == 2
    assert "--plots: is not supported by --solver paper" in refused.output


def test_a_turn_out_of_the_windows_view_does_not_stop_it():
    """Half a turn within a window: rays derotated to its first frame come to lie behind it."""
    simulation, stream = recording()
    odometry = PaperOdometry(simulation.calibration)
    for i, m in enumerate(stream[:400]):
        turning = i > 200 and isinstance(m, ImuSample)
        odometry.add(
            m._replace(gyroscope=m.gyroscope + np.array([0.0, 4.0, 0.0])) if turning else m
        )
    odometry.finish()
    poses = [estimate.world_T_body for estimate in odometry.take_smoothed()]
    assert np.isfinite([pose.matrix() for pose in poses]).all()
