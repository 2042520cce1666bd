# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Named motions: start, derivatives, and an IMU that integrates to them."""

import gtsam
import numpy as np
import pytest

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation import D435I, MOTIONS, make_motion, make_scene, simulate, simulate_imu

BODY_R_CAM = D435I.body_T_cam.rotation().matrix()

# The 31 rows of the paper's tables 1 to 5 (table 5 names scenes; the motion is free).
TABLE_1 = [
    f"{kind}-{direction}"
    for kind, direction in (
        ("linear", "parallel"),
        ("linear", "perpendicular"),
        ("circular", "parallel"),
        ("circular", "perpendicular"),
        ("circular", "tilted"),
    )
]
TABLE_2 = [f"{name}-rot-{axis}" for name in TABLE_1 for axis in "xyz"]
TABLE_3 = [
    "zigzag-parallel",
    "zigzag-perpendicular",
    "zigzag-tilted",
    "square-parallel",
    "square-perpendicular",
]
ROWS = [
    *(("square", name, 0) for name in TABLE_1 + TABLE_2 + TABLE_3),
    ("noncoplanar", "circular-tilted", 0),
    ("noncoplanar", "circular-tilted-rot-y", 0),
    ("square", "free", 1),
    ("square", "free", 2),
    ("noncoplanar", "free", 1),
    ("noncoplanar", "free", 2),
]


@pytest.mark.parametrize("moving_start", [False, True])
@pytest.mark.parametrize("name", MOTIONS)
def test_imu_integrates_to_the_motion(name: str, moving_start: bool) -> None:
    """1 mm over 12 s, from an ideal IMU; at 1 kHz, so that the sampling itself costs little."""
    motion = make_motion(name, BODY_R_CAM, 12.0, moving_start, seed=1)
    imu = simulate_imu(motion, 1000.0, None, np.random.default_rng(0)).samples
    params = gtsam.PreintegrationParams.MakeSharedU(9.81)
    state = gtsam.NavState(motion.pose(0.0), motion.velocity(0.0))
    for second in range(12):
        preintegrated = gtsam.PreintegratedImuMeasurements(params)
        for segment in imu.segments(second, second + 1):
            preintegrated.integrateMeasurement(*segment)
        state = preintegrated.predict(state, gtsam.imuBias.ConstantBias())
        error = state.position() - motion.position(second + 1.0)
        assert np.linalg.norm(error) < 1e-3


@pytest.mark.parametrize("name", MOTIONS)
def test_starts_at_rest_or_moving_as_told(name: str) -> None:
    resting = make_motion(name, BODY_R_CAM)
    times = np.linspace(0.0, 1.0, 20)
    assert np.abs(resting.velocity(times)).max() == 0.0
    assert np.abs(resting.angular_velocity(times)).max() == 0.0
    assert np.linalg.norm(resting.velocity(np.linspace(2.0, 12.0, 500)), axis=1).max() > 0.25
    moving = make_motion(name, BODY_R_CAM, moving_start=True)
    assert np.linalg.norm(moving.velocity(0.0)) > 0.1


@pytest.mark.parametrize("name", MOTIONS)
def test_is_physically_possible(name: str) -> None:
    """Finite accelerations of a hand or a robot, no jump of velocity or position anywhere."""
    motion = make_motion(name, BODY_R_CAM, 40.0, seed=3)
    times = np.arange(0.0, 40.0, 1e-3)
    acceleration = motion.acceleration(times)
    assert np.linalg.norm(acceleration, axis=1).max() < 12.0
    step = np.diff(motion.velocity(times), axis=0)
    np.testing.assert_allclose(step, 0.5e-3 * (acceleration[1:] + acceleration[:-1]), atol=2e-4)
    step = np.diff(motion.position(times), axis=0)
    velocity = motion.velocity(times)
    np.testing.assert_allclose(step, 0.5e-3 * (velocity[1:] + velocity[:-1]), atol=2e-6)


@pytest.mark.parametrize(("axis", "direction"), [("x", 0), ("y", 1), ("z", 2)])
def test_added_rotation_is_about_the_cameras_own_axis(axis: str, direction: int) -> None:
    motion = make_motion(f"linear-parallel-rot-{axis}", BODY_R_CAM, moving_start=True)
    rates = motion.angular_velocity(np.linspace(0.0, 4.0, 50)) @ BODY_R_CAM
    assert np.abs(rates[:, direction]).max() > 0.2
    assert np.abs(np.delete(rates, direction, axis=1)).max() < 1e-12


def test_motion_without_rotation_has_none() -> None:
    for name in TABLE_1 + TABLE_3:
        motion = make_motion(name, BODY_R_CAM)
        assert np.abs(motion.angular_velocity(np.linspace(0.0, 12.0, 100))).max() == 0.0


@pytest.mark.parametrize(("name", "still"), [("parallel", 0), ("perpendicular", 2)])
@pytest.mark.parametrize("kind", ["linear", "circular", "zigzag", "square"])
def test_directions_are_relative_to_the_scenes_plane(kind: str, name: str, still: int) -> None:
    """The plane is perpendicular to x: nothing parallel moves along x; z stays level otherwise."""
    positions = make_motion(f"{kind}-{name}", BODY_R_CAM).position(np.linspace(0.0, 12.0, 500))
    extent = np.ptp(positions, axis=0)
    assert extent[still] < 1e-12
    assert extent.max() > 0.3


def test_squares_stop_at_their_corners() -> None:
    motion = make_motion("square-parallel", BODY_R_CAM, moving_start=True)
    times = np.linspace(0.0, 12.0, 4000)
    speed = np.linalg.norm(motion.velocity(times), axis=1)
    corners = np.unique(motion.position(times[speed < 1e-12])[:, 1:].round(6), axis=0)
    assert len(corners) == 4


def test_free_motion_depends_on_its_seed() -> None:
    first, again, other = (make_motion("free", BODY_R_CAM, seed=seed) for seed in (1, 1, 2))
    times = np.linspace(0.0, 12.0, 30)
    assert np.array_equal(first.position(times), again.position(times))
    assert np.abs(first.position(times) - other.position(times)).max() > 0.1


def test_walk_stays_inside_the_corridor_for_an_hour() -> None:
    motion = make_motion("walk", BODY_R_CAM, 3600.0)
    positions = motion.position(np.arange(0.0, 3600.0, 0.1))
    assert np.all(np.abs(positions[:, 1:]) < 0.1)
    assert -1.0 < positions[:, 0].min() < 0.0
    assert 15.0 < positions[:, 0].max() < 16.0


def test_all_rows_of_the_papers_tables_can_be_simulated() -> None:
    assert len(ROWS) == 31
    scenes = {name: make_scene(name) for name in ("square", "noncoplanar")}
    for scene, motion, seed in ROWS:
        simulation = simulate(scenes[scene], motion, seed=seed)
        assert len(simulation.frame_times()) == 1080
        # 12 s lie within the motion, and the lines before the camera at its start.
        pose = simulation.motion.pose(0.0) * simulation.calibration.body_T_cam
        ends = np.array([pose.transformTo(point) for point in simulation.lines[:4].reshape(-1, 3)])
        assert np.all(ends[:, 2] > 0.5)


def test_unknown_names_and_durations_are_refused() -> None:
    with pytest.raises(RuledgraphError, match=r"^unknown motion 'loop'; use one of linear-par"):
        make_motion("loop", BODY_R_CAM)
    with pytest.raises(RuledgraphError, match=r"^duration 0 s is not positive$"):
        make_motion("free", BODY_R_CAM, 0)
