# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""New lines from one image; the first window's linear solver and what it refuses."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ruledgraph.simulation import SplineMotion
from ruledgraph_factors import (
    STANDARD_GRAVITY,
    DegenerateWindowError,
    FactorError,
    FrameMotion,
    LineTrack,
    WindowSolution,
    line_from_ruling,
    preintegrate_frames,
    solve_first_window,
)
from simulated_window import (
    BODY_T_CAM,
    DURATION,
    FOCAL_LENGTH,
    SEGMENTS,
    Window,
    hand_held,
    simulate_window,
)

TIMES = np.linspace(0.0, DURATION, 9)
STILL = np.zeros((9, 3))
TURNING = 0.3 * np.sin(TIMES[:, None] * np.array([2.0, 3.0, 1.0]))


def test_line_from_ruling_fits_the_points() -> None:
    rng = np.random.default_rng(0)
    along = rng.uniform(-0.3, 0.3, size=200)
    points = np.column_stack([along, 0.1 + 0.5 * along]) + rng.normal(size=(200, 2)) * 1e-3
    world_T_cam = gtsam.Pose3(gtsam.Rot3.Ypr(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    chart = line_from_ruling(world_T_cam, points, 0.5)
    closest, _ = chart.closest_point(np.zeros(4))
    assert np.linalg.norm(closest - world_T_cam.translation()) == pytest.approx(2.0)
    ends, _ = chart.end_points(np.zeros(4), [-0.5, 0.5])
    for end in ends:
        x, y, z = world_T_cam.transformTo(end)
        # 200 points of 1e-3 fix the line to about 1e-4 where it was seen, 3e-4 at these ends.
        assert y / z == pytest.approx(0.1 + 0.5 * x / z, abs=1e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0.1, 0.2]], r"points has 1 point\(s\), a line takes two"),
        ([[0.1, 0.2], [0.1, 0.2]], "points all coincide"),
        ([[0.1, np.nan], [0.1, 0.2]], "points has a NaN"),
    ],
)
def test_line_from_ruling_names_what_is_wrong(points: list, message: str) -> None:
    with pytest.raises(FactorError, match=message):
        line_from_ruling(gtsam.Pose3(), points, 0.5)


def solve(
    window: Window,
    frames: slice = slice(None),
    bias_error: float = 0.0,
    sigma: float = 1e-3,
) -> WindowSolution:
    """`bias_error` (rad/s): of what is believed of the gyroscope, on each axis."""
    used = np.arange(len(window.times))[frames]
    true_bias = window.imu.bias_at(0.0)
    bias = gtsam.imuBias.ConstantBias(
        true_bias.accelerometer(), true_bias.gyroscope() + bias_error * np.array([1.0, -1.0, 1.0])
    )
    motion = preintegrate_frames(
        window.imu.samples, window.times[used[0]], window.times[used], bias
    )
    tracks = [LineTrack(range(len(used)), [edges[i] for i in used]) for edges in window.edges]
    return solve_first_window(motion, tracks, BODY_T_CAM, sigma)


def errors(window: Window, solution: WindowSolution, segments=SEGMENTS) -> tuple[float, ...]:
    """Velocity, gravity and worst line error; frames differ by the yaw that no one can know."""
    solved_R_true = solution.world_T_body.rotation() * window.motion.pose(0.0).rotation().inverse()
    velocity = solved_R_true.rotate(window.motion.velocity(0.0))
    gravity = solved_R_true.rotate(np.array(STANDARD_GRAVITY))
    solved_T_true = solution.world_T_body * window.motion.pose(0.0).inverse()
    distances = [
        chart.distance_to(np.zeros(4), solved_T_true.transformFrom(end))[0]
        for chart, ends in zip(solution.charts, segments, strict=False)
        for end in ends
    ]
    return (
        float(np.linalg.norm(solution.velocity - velocity)),
        float(np.linalg.norm(solution.gravity - gravity)),
        max(distances),
    )


def test_exact_measurements_give_the_exact_solution() -> None:
    """Up to the integrator's own error at 400 Hz."""
    for seed in range(3):
        window = simulate_window(np.random.default_rng(seed), noise=None, pixel_noise=0.0)
        velocity, gravity, lines = errors(window, solve(window))
        assert velocity < 1e-3
        assert gravity < 2e-3
        assert lines < 2e-3


def test_noisy_moving_start_is_solved_in_metres() -> None:
    """0.5 px and a D435i-like IMU, moving from the first frame, for each of 20 seeds."""
    for seed in range(20):
        window = simulate_window(np.random.default_rng(seed))
        solution = solve(window)
        velocity, gravity, lines = errors(window, solution)
        assert velocity < 0.02
        assert gravity < 0.05
        assert lines < 0.04
        assert solution.velocity_sigma < 0.01
        # World z is up, and the body's x axis is level in x-z: yaw is zero.
        assert solution.gravity[2] == pytest.approx(-9.81, abs=0.05)
        assert abs(solution.world_T_body.rotation().matrix()[1, 0]) < 1e-9


def test_large_gyroscope_bias_is_no_trouble_once_known() -> None:
    """0.08 rad/s, as the EuRoC recordings have."""
    bias = np.array([0.0, 0.0, 0.0, -0.002, 0.021, 0.077])
    window = simulate_window(np.random.default_rng(4), imu_bias=bias)
    velocity, gravity, _ = errors(window, solve(window))
    assert velocity < 0.02
    assert gravity < 0.05


def test_lines_may_be_seen_in_part_of_the_window() -> None:
    window = simulate_window(np.random.default_rng(1))
    motion = preintegrate_frames(window.imu.samples, 0.0, window.times, window.imu.bias_at(0.0))
    seen = [range(140), range(100), range(40, 140), range(0, 140, 3)]
    tracks = [
        LineTrack(frames, [edges[i] for i in frames])
        for frames, edges in zip(seen, window.edges, strict=True)
    ]
    velocity, gravity, _ = errors(window, solve_first_window(motion, tracks, BODY_T_CAM))
    assert velocity < 0.02
    assert gravity < 0.05


def upright(y: float) -> list[list[float]]:
    return [[2.0, y, -0.5], [2.0, y, 0.5]]


def camera_turns_on_the_spot() -> SplineMotion:
    lever = np.array(BODY_T_CAM.translation())
    return SplineMotion(TIMES, -Rotation.from_rotvec(TURNING).apply(lever), TURNING)


DEGENERATE = {
    "at rest": (
        {"motion": SplineMotion(TIMES, STILL, STILL)},
        "planes of 0 line.* the camera rests",
    ),
    "pure rotation": ({"motion": camera_turns_on_the_spot()}, "planes of 0 line.* only rotates"),
    "constant velocity": (
        {"motion": SplineMotion(TIMES, np.outer(TIMES, [0.0, 0.3, 0.2]), STILL)},
        "the acceleration hardly changes",
    ),
    "constant velocity, turning": (
        {"motion": SplineMotion(TIMES, np.outer(TIMES, [0.0, 0.3, 0.2]), TURNING)},
        "the acceleration hardly changes",
    ),
    "constant acceleration": (
        {"motion": SplineMotion(TIMES, np.outer(TIMES**2, [0.1, -0.2, 0.3]), STILL)},
        "the acceleration hardly changes",
    ),
    "one line": ({"segments": SEGMENTS[:1]}, r"1 line\(s\) in the window"),
    "parallel lines": (
        {"segments": np.array([upright(y) for y in (-0.5, -0.2, 0.3, 0.6)])},
        "all lines are parallel",
    ),
}


@pytest.mark.parametrize("exact", [True, False], ids=["exact", "noisy"])
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_windows_are_refused_with_the_reason(name: str, exact: bool) -> None:
    arguments, message = DEGENERATE[name]
    quiet = {"noise": None, "pixel_noise": 0.0} if exact else {}
    for seed in range(3):
        rng = np.random.default_rng(seed)
        window = simulate_window(rng, **(arguments | quiet))
        with pytest.raises(DegenerateWindowError, match=message):
            solve(window)


def test_motion_along_two_parallel_lines_and_one_across_is_solved() -> None:
    """Parallel lines are no harm as long as one is not."""
    window = simulate_window(np.random.default_rng(2), segments=SEGMENTS[:3])
    velocity, _, _ = errors(window, solve(window), SEGMENTS[:3])
    assert velocity < 0.05


def test_wrong_association_is_refused() -> None:
    """Half-way through, two tracks swap their lines."""
    window = simulate_window(np.random.default_rng(0))
    first, second = window.edges[0], window.edges[1]
    window.edges[0], window.edges[1] = first[:70] + second[70:], second[:70] + first[70:]
    with pytest.raises(DegenerateWindowError, match="association"):
        solve(window)


def test_error_shrinks_with_the_noise() -> None:
    quiet = simulate_window(np.random.default_rng(3), noise=None, pixel_noise=0.05)
    loud = simulate_window(np.random.default_rng(3), noise=None, pixel_noise=1.0)
    worst = [errors(w, solve(w, sigma=1.0 / FOCAL_LENGTH))[2] for w in (quiet, loud)]
    assert worst[0] < 0.2 * worst[1]


def hovering(rng: np.random.Generator) -> SplineMotion:
    return hand_held(rng, reach=0.05, turn=0.05)


@pytest.mark.parametrize("move", [hand_held, hovering])
def test_gyroscope_bias_known_to_a_fiftieth_of_a_radian_is_enough(move) -> None:
    """0.02 rad/s wrong on each axis; it comes out improved."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        window = simulate_window(rng, motion=move(rng))
        solution = solve(window, bias_error=0.02)
        velocity, gravity, lines = errors(window, solution)
        assert velocity < 0.02
        assert gravity < 0.05
        assert lines < 0.08
        left = solution.bias.gyroscope() - window.imu.bias_at(0.0).gyroscope()
        assert np.abs(left).max() < 0.01


def test_two_points_a_frame_will_do() -> None:
    """The end points that a line detector gives."""
    for seed in range(5):
        window = simulate_window(np.random.default_rng(seed), points=2)
        velocity, gravity, _ = errors(window, solve(window))
        assert velocity < 0.03
        assert gravity < 0.05


def test_sharp_edges_with_an_error_common_to_a_frame_are_accepted() -> None:
    """Blur and calibration shift a whole edge: the scatter within a frame is not the error."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        window = simulate_window(rng, points=50, pixel_noise=0.15)
        for edges in window.edges:
            for i, points in enumerate(edges):
                edges[i] = points + rng.normal(size=2) * 0.3 / FOCAL_LENGTH
        velocity, gravity, _ = errors(window, solve(window))
        assert velocity < 0.03
        assert gravity < 0.05


@pytest.mark.parametrize("distance", [50.0, 1000.0])
def test_a_far_line_does_no_harm(distance: float) -> None:
    far = distance * np.array([[[1.0, 0.1, -0.2], [1.0, -0.1, 0.2]]])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        segments = np.concatenate([SEGMENTS, far])
        window = simulate_window(rng, motion=hovering(rng), segments=segments)
        solution = solve(window)
        assert len(solution.charts) == 5
        velocity, gravity, lines = errors(window, solution)  # lines: of the near ones
        assert velocity < 0.02
        assert gravity < 0.05
        assert lines < 0.08


def test_short_windows_are_refused_or_right() -> None:
    """A fifth of a second, or five frames at 20 Hz: mostly too little, never silently wrong."""
    refused = 0
    for seed in range(10):
        window = simulate_window(np.random.default_rng(seed))
        for frames in (slice(0, 25, 5), slice(0, 20)):
            try:
                solution = solve(window, frames)
            except DegenerateWindowError:
                refused += 1
                continue
            velocity, gravity, _ = errors(window, solution)
            # Three sigmas of a vector's length, and the accelerometer on top.
            assert velocity < 3.0 * solution.velocity_sigma + 0.02
            assert gravity < 3.0 * solution.gravity_sigma + 0.05
    assert refused >= 10


MOTION = FrameMotion(np.array([0.0, 0.1]), np.zeros((2, 9)), np.zeros((2, 9, 6)), np.zeros(6))
TWO = [[[0.0, 0.0], [0.1, 0.0]], [[0.0, 0.0], [0.1, 0.0]]]


@pytest.mark.parametrize(
    ("tracks", "message"),
    [
        (
            [LineTrack([0, 1], TWO), LineTrack([0, 2], TWO)],
            r"tracks\[1\].frames must lie in 0 to 1",
        ),
        ([LineTrack([0, 1], TWO), LineTrack([1, 0], TWO)], r"tracks\[1\].frames must increase"),
        (
            [LineTrack([0], TWO), LineTrack([0, 1], TWO)],
            r"tracks\[0\] has 1 frames, but points of 2",
        ),
        (
            [LineTrack([0], [[[0.1, 0.1]]]), LineTrack([0, 1], TWO)],
            r"tracks\[0\].points\[0\] has 1 point\(s\), a line takes two",
        ),
        (
            [LineTrack([0], [[[0.1, np.nan]]]), LineTrack([0, 1], TWO)],
            r"tracks\[0\].points\[0\] has a NaN",
        ),
    ],
)
def test_bad_tracks_are_named(tracks: list[LineTrack], message: str) -> None:
    with pytest.raises(FactorError, match=message):
        solve_first_window(MOTION, tracks)
