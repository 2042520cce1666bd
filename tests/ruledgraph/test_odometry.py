# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The trajectory of small simulated recordings, and what it is computed from."""

from dataclasses import replace

import numpy as np
import pytest

import ruledgraph
from ruledgraph.calibration.imu_noise import ADIS16448_LIKE
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.core.settings import load_config
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.odometry import Odometry
from ruledgraph.simulation.options import simulation_from_options
from ruledgraph_factors import kernel
from small_runs import ate, run
from small_simulation import frames, small_simulation, small_stream


@pytest.mark.parametrize("moving", [False, True], ids=["from rest", "moving"])
def test_the_trajectory_of_a_simulated_recording(moving):
    stream, calibration = small_stream(moving=moving)
    odometry, live, smoothed = run(stream, calibration)
    simulation = small_simulation(moving=moving)
    assert odometry.recoveries == []
    # A quarter of the default image and a third of its rate; at full size it is below 1 mm.
    assert ate(live, simulation) < 0.02
    assert ate(smoothed, simulation) < 0.015
    # Every frame from the start on, but for those after the last IMU sample.
    stamps = [frame.stamp for frame in frames(stream)]
    for estimates in (live, smoothed):
        first = stamps.index(estimates[0].stamp)
        assert [e.stamp for e in estimates] == stamps[first : first + len(estimates)]
        assert first + len(estimates) >= len(stamps) - 3
    assert len(live) > (0.55 if moving else 0.7) * len(stamps)
    lines = odometry.take_lines()
    assert len(lines) > 5
    for line in lines:
        assert line.first_stamp < line.last_stamp
        assert np.all(np.linalg.eigvalsh(line.covariance) > -1e-9)


def test_a_plane_whose_images_turn_in_two_ways_keeps_the_windows_time_offset():
    """A second motion explains the images of a plane as well as the camera's own; its rotation
    follows the gyroscope's 27 ms later.
    """
    simulation = simulation_from_options(
        scene="square", motion="linear-parallel-rot-y", rate=30.0, duration=3.5
    )
    odometry, live, _ = run(simulation.stream(), simulation.calibration)
    assert abs(odometry.calibration_search.found.value) > 0.02
    assert not odometry.warnings
    assert len(live) > 90
    assert ate(live, simulation) < 0.005


def test_the_same_input_gives_the_same_output():
    stream, calibration = small_stream()
    stream = stream[: len(stream) // 2]
    first, second = (run(stream, calibration) for _ in range(2))
    for one, other in zip(first[1] + first[2], second[1] + second[2], strict=True):
        assert one.stamp == other.stamp
        np.testing.assert_array_equal(one.world_T_body.matrix(), other.world_T_body.matrix())


@pytest.mark.skipif(kernel.native is None, reason="the native kernel was not built")
def test_both_kernels_give_the_same_trajectory(monkeypatch):
    stream, calibration = small_stream()
    results = []
    for name in ("native", "numpy"):
        monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
        _, live, smoothed = run(stream, calibration)
        results.append(live + smoothed)
    for one, other in zip(*results, strict=True):
        assert (one.stamp, one.lines) == (other.stamp, other.lines)
        np.testing.assert_allclose(
            one.world_T_body.matrix(), other.world_T_body.matrix(), rtol=0.0, atol=1e-6
        )


def test_smooth_yields_the_live_estimates():
    stream, calibration = small_stream()
    stream = stream[: len(stream) // 2]
    estimates = list(ruledgraph.smooth(stream, calibration))
    _, live, _ = run(stream, calibration)
    assert [e.stamp for e in estimates] == [e.stamp for e in live]


def test_frames_that_wait_for_the_imu_are_not_all_prepared(monkeypatch):
    _, calibration = small_stream()
    odometry, made = Odometry(calibration), []

    def counted(image: np.ndarray) -> Gradient:
        made.append(image)
        return Gradient(image)

    monkeypatch.setattr("ruledgraph.frontend.front_end.Gradient", counted)
    for i in range(100):
        frame = Frame(10_000_000 * i, np.full((240, 320), i, np.uint8))
        odometry.prefetch(frame)
        odometry.add_image(frame)
    assert 0 < len(made) < 50


def test_memory_of_a_run_does_not_grow():
    stream, calibration = small_stream(duration=7.5)
    odometry = Odometry(calibration)
    for measurement in stream:
        odometry.add(measurement)
        odometry.take_live(), odometry.take_smoothed(), odometry.take_lines()
    assert odometry.window is not None
    # The window, the time that a rest is not solved for, and some to spare.
    kept = odometry.config.window.lag + 2.5
    assert len(odometry.window.nodes) < 10 * kept
    assert all(len(track.sightings) < 30 * kept for track in odometry.tracker.tracks)


@pytest.mark.parametrize("jump", [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.05, 0.0, 0.0]])
def test_biases_that_jump_are_found_anew(jump):
    stream, calibration = small_stream(moving=True)
    at = stream[0].stamp + 2_500_000_000
    _, usual, _ = run(stream, calibration)
    jumping = [
        m._replace(accelerometer=m.accelerometer + jump[:3], gyroscope=m.gyroscope + jump[3:])
        if isinstance(m, ImuSample) and m.stamp > at
        else m
        for m in stream
    ]
    odometry, live, _ = run(jumping, calibration)
    assert sum("images and IMU have disagreed" in warning for warning in odometry.warnings) == 1
    # Told at the state after it, and over at the next one or, the velocity being known again, two.
    told = [e.stamp for e in live if e.status == "degraded" and e.stamp > at]
    assert at < told[0] < at + 300_000_000
    assert told[-1] < told[0] + 450_000_000
    assert {e.segment for e in live} == {0}
    assert ate(live, small_simulation(moving=True)) < 0.02  # 0.36 m and 0.05 m without
    off = live[-1].bias.vector() - usual[-1].bias.vector() - jump
    assert np.abs(off[:3]).max() < 0.1
    assert np.abs(off[3:]).max() < 0.005


def test_the_papers_points_work_too():
    stream, calibration = small_stream()
    odometry = Odometry(calibration, load_config(None, ["edges.points=sobel"]))
    live = []
    for measurement in stream:
        odometry.add(measurement)
        live += odometry.take_live()
    assert len(live) > 60
    assert ate(live, small_simulation()) < 0.05  # whole pixels of both sides of an edge


def test_every_frames_velocity_is_its_own():
    """Not that of the state before it, from which it differs by 0.3 m/s and more."""
    stream, calibration = small_stream(moving=True)
    _, live, smoothed = run(stream, calibration)
    for estimates in (live, smoothed):
        true = small_simulation(moving=True).truth(np.array([e.stamp for e in estimates]))
        own = np.linalg.norm([e.velocity for e in estimates], axis=1)
        off = own - np.linalg.norm(true.velocity, axis=1)
        assert np.sqrt(np.mean(off**2)) < 0.05
        # Within 0.2 s they would lag behind by as much as the body speeds up.
        assert np.abs(off).max() < 0.2


@pytest.mark.parametrize(
    ("least", "expected"), [("0.02", 0.02), ("0", ADIS16448_LIKE.accelerometer)]
)
def test_the_imus_white_noise_is_no_less_than_in_motion(least, expected):
    calibration = replace(small_stream()[1], imu_noise=ADIS16448_LIKE)
    settings = [f"imu.min_accelerometer_noise={least}", "imu.min_gyroscope_noise=1e-4"]
    used = Odometry(calibration, load_config(None, settings)).online_calibration.current.imu_noise
    assert used == replace(ADIS16448_LIKE, accelerometer=expected)
