# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The motion that a recorded IMU felt, close to a measured trajectory."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ruledgraph.calibration.imu_noise import ADIS16448_LIKE
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.simulation import (
    MeasuredMotion,
    Motion,
    RecordedImu,
    SplineMotion,
    make_motion,
    simulate,
    simulate_imu,
)
from ruledgraph.simulation.inertial_motion import InertialMotion

FLIGHTS = Path(__file__).parents[4] / "shared" / "data" / "euroc_motion"
EPOCH = 1_500_000_000_000_000_000
BIAS = np.array([0.1, -0.2, 0.05, 0.003, -0.002, 0.07])
FRAME = 0.05
"""s, between two frames."""


def shaking(duration: float) -> SplineMotion:
    """A known motion that also turns by a third of a degree to and fro, 8 times a second."""
    smooth = make_motion("free", np.eye(3), duration, moving_start=True)
    times = np.linspace(0.0, duration, int(200 * duration) + 1)
    shake = 0.006 * np.sin(2 * np.pi * 8.0 * times)[:, None] * np.array([0.6, 0.8, 0.0])
    rotations = Rotation.from_matrix(smooth.rotation(times)) * Rotation.from_rotvec(shake)
    return SplineMotion(times, smooth.position(times), rotations.as_rotvec())


def measured(motion: Motion, sigma: float, turn: float) -> Trajectory:
    """Poses of a motion at 20 Hz with noise, m and rad."""
    rng = np.random.default_rng(0)
    times = np.arange(0.0, motion.stop + 1e-9, FRAME)
    turns = Rotation.from_rotvec(rng.normal(scale=turn, size=(times.size, 3)))
    rotations = Rotation.from_matrix(motion.rotation(times)) * turns
    positions = motion.position(times) + rng.normal(scale=sigma, size=(times.size, 3))
    return Trajectory(
        EPOCH + np.round(times * 1e9).astype(np.int64), positions, rotations.as_quat()
    )


def turns(motion: Motion, times: FloatArray) -> FloatArray:
    """From each time to a frame later, as rotation vectors."""
    one, other = (Rotation.from_matrix(motion.rotation(t)) for t in (times, times + FRAME))
    return np.asarray((one.inv() * other).as_rotvec())


def felt(duration: float) -> tuple[SplineMotion, Trajectory, InertialMotion]:
    """The true motion, its poses as measured, and what these and an IMU make of it."""
    truth = shaking(duration)
    poses = measured(truth, 1e-3, 2e-3)
    imu = simulate_imu(truth, 200.0, ADIS16448_LIKE, np.random.default_rng(1), BIAS)
    stamps = EPOCH + np.round(imu.samples.times * 1e9).astype(np.int64)
    return truth, poses, InertialMotion(poses, stamps, imu.samples, ADIS16448_LIKE)


def test_it_turns_as_the_gyroscope_says_and_stays_with_the_poses() -> None:
    truth, poses, motion = felt(8.0)
    assert motion.epoch == EPOCH
    assert motion.stop == pytest.approx(8.0)
    times = np.arange(0.5, 7.4, 0.02)
    # The gyroscope's noise turns it by 0.04 mrad within a frame; a curve through the poses misses
    # the shaking, 6 mrad, and follows their noise.
    error = turns(motion, times) - turns(truth, times)
    assert np.sqrt(np.mean(error**2)) < 1e-4
    curve = turns(MeasuredMotion(poses), times) - turns(truth, times)
    assert np.sqrt(np.mean(curve**2)) > 1e-3
    # As well known as poses are that average five a second over about a second.
    assert np.abs(motion.position(times) - truth.position(times)).max() < 3e-3
    between = Rotation.from_matrix(motion.rotation(times)).inv() * Rotation.from_matrix(
        truth.rotation(times)
    )
    assert between.magnitude().max() < 5e-3


def test_velocity_and_bias_are_the_true_ones() -> None:
    truth, _, motion = felt(8.0)
    times = np.arange(0.5, 7.4, 0.02)
    velocity = motion.velocity(times) - truth.velocity(times)
    assert np.sqrt(np.mean(velocity**2)) < 5e-3
    inner = slice(1, -1)
    # Tilt of 2 mrad passes for 0.02 m/s^2, and the walk is 0.003 m/s^2 a second.
    np.testing.assert_allclose(motion.bias[inner, :3], np.tile(BIAS[:3], (7, 1)), atol=0.03)
    np.testing.assert_allclose(motion.bias[inner, 3:], np.tile(BIAS[3:], (7, 1)), atol=5e-4)
    assert motion.bias_stamps[0] == EPOCH + 500_000_000


def test_a_jump_of_the_tracker_is_not_followed() -> None:
    truth = shaking(6.0)
    poses = measured(truth, 1e-3, 2e-3)
    positions = poses.positions.copy()
    positions[60:63] += 0.1
    jumped = Trajectory(poses.stamps, positions, poses.quaternions)
    imu = simulate_imu(truth, 200.0, ADIS16448_LIKE, np.random.default_rng(1), BIAS)
    stamps = EPOCH + np.round(imu.samples.times * 1e9).astype(np.int64)
    motion = InertialMotion(jumped, stamps, imu.samples, ADIS16448_LIKE)
    times = np.arange(0.5, 5.4, 0.02)
    assert np.abs(motion.position(times) - truth.position(times)).max() < 0.01


def write_imu(path: Path, motion: Motion) -> None:
    """EuRoC's file of an IMU on a motion."""
    imu = simulate_imu(motion, 200.0, ADIS16448_LIKE, np.random.default_rng(1), BIAS)
    rows = zip(imu.samples.times, imu.samples.gyroscope, imu.samples.accelerometer, strict=True)
    with path.open("w") as file:
        for time, gyroscope, accelerometer in rows:
            values = ",".join(str(v) for v in [*gyroscope, *accelerometer])
            file.write(f"{EPOCH + round(time * 1e9)},{values}\n")


def test_views_and_truth_of_a_simulation_follow_the_recorded_imu(tmp_path: Path) -> None:
    truth = shaking(4.0)
    write_imu(tmp_path / "imu0.csv", truth)
    curve = MeasuredMotion(measured(truth, 1e-3, 2e-3))
    simulation = simulate("room", curve, imu=RecordedImu(tmp_path / "imu0.csv"), rate=20.0)
    times = np.arange(0.5, 3.4, 0.02)
    error = turns(simulation.motion, times) - turns(truth, times)
    assert np.sqrt(np.mean(error**2)) < 1e-4
    states = simulation.truth(simulation.stamps(times))
    np.testing.assert_allclose(states.bias[:, 3:], np.tile(BIAS[3:], (len(times), 1)), atol=1e-3)
    with pytest.raises(RuledgraphError, match="goes with a measured motion alone"):
        simulate("square", "free", imu=RecordedImu(tmp_path / "imu0.csv"))


@pytest.mark.skipif(
    not FLIGHTS.is_dir(), reason="the EuRoC recordings are not beside the repository"
)
@pytest.mark.parametrize("name", ["V1_01_easy", "MH_04_difficult"])
def test_flights_turn_as_their_gyroscope(name: str) -> None:
    """Not that of MH_04's last minute, where the truth jumps by 0.14 m."""
    curve = MeasuredMotion.read(FLIGHTS / name / "groundtruth.csv", 15.0, 20.0)
    simulation = simulate("hall", curve, imu=RecordedImu(FLIGHTS / name / "imu0.csv"), rate=20.0)
    samples = list(simulation.imu.samples())
    stamps = np.array([sample.stamp for sample in samples])
    rates = np.array([s.gyroscope for s in samples]) - simulation.imu.bias_at(stamps)[:, 3:]
    moments = (stamps - simulation.epoch) * 1e-9
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(moments)[:, None]
    angles = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    times = np.arange(1.0, 18.9, FRAME)
    turned = np.stack(
        [np.interp(times + FRAME, moments, a) - np.interp(times, moments, a) for a in angles.T], 1
    )
    # A twentieth of a pixel is 0.1 mrad; a body that turns in different planes within a frame
    # leaves half of that in the plain sum of angles.
    error = turns(simulation.motion, times) - turned
    assert np.sqrt(np.mean(error**2)) < 1e-4
    distance = simulation.motion.position(moments) - curve.position(moments)
    assert np.sqrt(np.mean(distance**2)) < 0.01
