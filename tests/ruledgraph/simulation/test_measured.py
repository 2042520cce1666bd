# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Motion from a measured trajectory, with a simulated and with the recorded IMU."""

from pathlib import Path

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ruledgraph.calibration import read_calibration
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.simulation import (
    D435I,
    MeasuredMotion,
    RecordedImu,
    make_motion,
    simulate,
    simulate_imu,
)

SHARED = Path(__file__).parents[4] / "shared" / "data"
FLIGHTS = {name: SHARED / "euroc_motion" / name for name in ("V1_01_easy", "MH_04_difficult")}
needs_flights = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the EuRoC recordings are not beside the repository"
)
EPOCH = 1_500_000_000_000_000_000


def measured(
    rate: float = 100.0, duration: float = 8.0, deviation: float = 0.0
) -> tuple[MeasuredMotion, Trajectory]:
    """A known motion, measured with noise, as a motion again."""
    known = make_motion("free", np.eye(3), duration, moving_start=True)
    times = np.arange(0.0, duration, 1.0 / rate)
    noise = np.random.default_rng(0).normal(scale=deviation, size=(len(times), 3))
    trajectory = Trajectory(
        np.round(times * 1e9).astype(np.int64) + EPOCH,
        known.position(times) + noise,
        Rotation.from_matrix(known.rotation(times)).as_quat(),
    )
    return MeasuredMotion(trajectory), trajectory


def test_follows_a_smooth_trajectory() -> None:
    motion, trajectory = measured()
    known = make_motion("free", np.eye(3), 8.0, moving_start=True)
    times = np.linspace(0.5, 7.4, 300)
    assert motion.epoch == trajectory.stamps[0]
    np.testing.assert_allclose(motion.position(times), known.position(times), atol=1e-5)
    np.testing.assert_allclose(motion.velocity(times), known.velocity(times), atol=1e-3)
    np.testing.assert_allclose(motion.acceleration(times), known.acceleration(times), atol=0.03)
    np.testing.assert_allclose(motion.rotation(times), known.rotation(times), atol=1e-4)
    rates = motion.angular_velocity(times) - known.angular_velocity(times)
    assert np.abs(rates).max() < 1e-3


def test_noise_of_the_measurement_does_not_shake_the_motion() -> None:
    """A millimetre at 100 Hz is 10 m/s^2 and more by plain differences."""
    motion, trajectory = measured(deviation=1e-3)
    times = np.linspace(0.5, 7.4, 300)
    known = make_motion("free", np.eye(3), 8.0, moving_start=True)
    acceleration = np.linalg.norm(motion.acceleration(times) - known.acceleration(times), axis=1)
    plain = np.diff(trajectory.positions, 2, axis=0) * 100.0**2
    assert np.sqrt(np.mean(plain**2)) > 10.0
    assert np.sqrt(np.mean(acceleration**2)) < 1.0


def test_imu_integrates_to_the_motion() -> None:
    motion, _ = measured(deviation=1e-3)
    imu = simulate_imu(motion, 1000.0, None, np.random.default_rng(0)).samples
    state = gtsam.NavState(motion.pose(0.0), motion.velocity(0.0))
    preintegrated = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81))
    for segment in imu.segments(0.0, 7.0):
        preintegrated.integrateMeasurement(*segment)
    end = preintegrated.predict(state, gtsam.imuBias.ConstantBias())
    np.testing.assert_allclose(end.position(), motion.position(7.0), atol=1e-3)


def test_gaps_and_short_trajectories_are_refused(tmp_path: Path) -> None:
    _, trajectory = measured()
    keep = np.ones(len(trajectory), dtype=bool)
    keep[200:300] = False
    with pytest.raises(RuledgraphError, match=r"has a gap of 1.01 s after 1.99 s; simulate a str"):
        MeasuredMotion(
            Trajectory(
                trajectory.stamps[keep], trajectory.positions[keep], trajectory.quaternions[keep]
            )
        )
    with pytest.raises(RuledgraphError, match=r"^a trajectory of 0.49 s is too short"):
        MeasuredMotion(measured(duration=0.5)[1])
    path = tmp_path / "truth.tum"
    trajectory.write_tum(path)
    with pytest.raises(RuledgraphError, match=r"no pose between 20.0 s and inf s$"):
        MeasuredMotion.read(path, start=20.0)
    part = MeasuredMotion.read(path, start=2.0, duration=4.0)
    assert (part.epoch, part.stop) == (EPOCH + 2_000_000_000, pytest.approx(4.0))


def test_scene_is_built_around_the_motion() -> None:
    motion, trajectory = measured()
    scene = simulate("room", motion).scene
    walls = scene.lines[["room." in name for name in scene.line_names]].reshape(-1, 3)
    assert np.all(walls.min(axis=0) < trajectory.positions.min(axis=0) - 0.9)
    assert np.all(walls.max(axis=0) > trajectory.positions.max(axis=0) + 0.9)
    with pytest.raises(RuledgraphError, match="the scene square has a fixed size"):
        simulate("square", motion)


def test_recorded_imu_files_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "imu0.csv"
    path.write_text("#stamp,wx,wy,wz,ax,ay,az\n1,0,0,0,0,0\n")
    with pytest.raises(RuledgraphError, match="6 columns, but EuRoC's IMU files have 7"):
        RecordedImu(path)
    path.write_text("#stamp,wx,wy,wz,ax,ay,az\n1,0,0,0,0,0,9.8\n2,0,0,0,0,0,9.8\n")
    motion, _ = measured()
    with pytest.raises(RuledgraphError, match=r"^the recorded IMU \(1 to 2 ns\) has no samples"):
        simulate("room", motion, imu=RecordedImu(path))


@needs_flights
@pytest.mark.parametrize(("name", "rms"), [("V1_01_easy", 2e-4), ("MH_04_difficult", 2e-3)])
def test_flights_are_matched_within_their_noise(name: str, rms: float) -> None:
    path = FLIGHTS[name] / "groundtruth.csv"
    motion, truth = MeasuredMotion.read(path), read_ground_truth(path).trajectory
    times = (truth.stamps - motion.epoch) * 1e-9
    error = np.linalg.norm(motion.position(times) - truth.positions, axis=1)
    assert np.sqrt(np.mean(error**2)) < rms
    turn = Rotation.from_matrix(motion.rotation(times)).inv() * Rotation.from_quat(
        truth.quaternions
    )
    assert np.degrees(np.sqrt(np.mean(turn.magnitude() ** 2))) < 0.1
    acceleration = np.linalg.norm(motion.acceleration(np.arange(0.0, motion.stop, 0.01)), axis=1)
    assert np.quantile(acceleration, 0.999) < 15.0


@needs_flights
def test_a_flight_in_a_room_with_its_own_imu() -> None:
    flight = FLIGHTS["V1_01_easy"]
    calibration = read_calibration(SHARED / "euroc_MH_01_30s" / "MH_01_30s.calib.yaml")
    simulation = simulate(
        "room",
        MeasuredMotion.read(flight / "groundtruth.csv", start=30.0, duration=1.5),
        calibration=calibration,
        rate=20.0,
        imu=RecordedImu(flight / "imu0.csv"),
    )
    measurements = list(simulation.stream())
    frames = [m for m in measurements if isinstance(m, Frame)]
    assert {frame.image.shape for frame in frames} == {(480, 752)}
    assert len(frames) == 28
    assert len(measurements) - len(frames) == pytest.approx(290, abs=11)
    assert simulation.truth([frames[3].stamp]).bias[0, 5] == pytest.approx(0.077, abs=0.002)
    # Something is to be seen.
    assert min(frame.image.std() for frame in frames) > 5.0


def test_named_imu_noise_is_the_calibrations() -> None:
    assert simulate("square", "free").calibration == D435I
