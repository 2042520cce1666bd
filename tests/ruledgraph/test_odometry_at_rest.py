# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A long rest: few states are solved for, and nothing moves."""

import cv2
import numpy as np
import pytest

from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.odometry import Odometry
from small_runs import run
from small_simulation import SMALL, frames, small_stream


def resting_stream(seconds: float, drift: float = 0.0) -> list[Measurement]:
    """The first frame again and again, with other noise, and an IMU that rests; the image drifts
    right and down by so many px/s.
    """
    stream, _ = small_stream()
    image, rng = frames(stream)[0].image, np.random.default_rng(0)
    noise, gravity = np.repeat([1e-3, 0.02], 3), np.array([0.0, 0.0, 9.81])
    resting: list[Measurement] = []
    for step in range(int(200 * seconds)):
        stamp, drawn = step * 5_000_000, noise * rng.normal(size=6)
        resting.append(ImuSample(stamp, drawn[:3], drawn[3:] + gravity))
        if step % 6 == 1:
            by = drift * stamp * 1e-9
            shift = np.array([[1.0, 0.0, by], [0.0, 1.0, by]])
            moved = cv2.warpAffine(image, shift, image.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
            grey = moved + rng.normal(scale=1.5, size=image.shape)
            resting.append(Frame(stamp, grey.clip(0, 255).astype(np.uint8)))
    return resting


def times_solved(monkeypatch) -> list[float]:
    """Of the newest state whenever a window is solved, from now on."""
    solved, optimize = [], Window.optimize

    def counted(window):
        solved.append(window.newest.time)
        return optimize(window)

    monkeypatch.setattr(Window, "optimize", counted)
    return solved


def test_a_long_rest_costs_little_and_moves_nothing(monkeypatch):
    solved = times_solved(monkeypatch)
    odometry, live, smoothed = run(resting_stream(6.0), small_stream()[1])
    nodes = [e for e in live if e.at_state]
    assert len(nodes) > 25
    # One state in four is solved for, and the one at the end.
    assert np.diff(solved)[:-1] == pytest.approx(0.8, abs=0.05)
    assert len(solved) <= 8
    assert {e.status for e in nodes[1:]} == {"still"}
    assert live[-1].lines >= 4  # few are longer than 40 px
    for estimates in (live, smoothed):
        places = np.array([e.world_T_body.translation() for e in estimates])
        assert np.linalg.norm(places - places[0], axis=1).max() < 0.002
    assert list(odometry.warnings) == []


def test_slow_motion_that_looks_like_rest_is_solved_as_often_as_it_moves(monkeypatch):
    """In 0.4 s the image moves by half of what rest allows; that alone would be rest for ever."""
    solved = times_solved(monkeypatch)
    odometry, live, _ = run(resting_stream(6.0, drift=0.5), small_stream()[1])
    assert odometry.warnings == []
    moving = [e for e in live if e.at_state and e.status == "tracking"]
    assert len(moving) >= 3
    assert np.median(np.diff(solved)) < 0.5


def test_a_recording_that_ends_at_an_unsolved_node_is_solved_to_its_end(monkeypatch):
    solved, odometry = times_solved(monkeypatch), Odometry(small_stream()[1])
    for measurement in resting_stream(3.0):
        odometry.add(measurement)
        live = odometry.take_live()
        if solved and live and live[-1].at_state and odometry.window.newest.time > solved[-1]:
            break
    end = odometry.window.newest.time
    assert odometry.window.solved < end
    odometry.finish()
    assert solved[-1] == end


def lifted(stream: list[Measurement], since: float, acceleration: float) -> list[Measurement]:
    """In a lift that sets off with so much, m/s^2."""
    return [
        m._replace(accelerometer=m.accelerometer + np.array([0.0, 0.0, acceleration]))
        if isinstance(m, ImuSample) and m.stamp >= since * 1e9
        else m
        for m in stream
    ]


@pytest.mark.parametrize(("since", "acceleration"), [(3.0, 1.0), (3.05, 0.5), (3.13, -1.0)])
def test_where_the_imu_alone_ends_a_rest_both_is_possible_until_the_image_shows_it(
    since, acceleration
):
    """And the estimate is back where the body has been all the time."""
    stream = lifted(resting_stream(5.0), since, acceleration)
    odometry, live, smoothed = run(stream, small_stream()[1])
    rest = live[-1].world_T_body
    open_until = since + 0.5  # until 0.4 s by the IMU are those of a rest, and the next frame
    for estimate in live:
        if since + 0.03 < estimate.time < since + 0.35:
            assert estimate.status in ("tracking", "degraded")
        if not since < estimate.time < open_until:
            assert np.linalg.norm(estimate.world_T_body.localCoordinates(rest)) < 2e-3
        error = estimate.world_T_body.localCoordinates(rest)
        # No more than is expected of six and of three dimensions.
        assert error @ np.linalg.solve(estimate.covariances[0], error) < 6.0
        velocity, of_velocity = estimate.velocity, estimate.covariances[1]
        assert velocity @ np.linalg.solve(of_velocity, velocity) < 3.0
    assert live[-1].status == "still"
    for estimate in smoothed:
        assert np.linalg.norm(estimate.world_T_body.localCoordinates(rest)) < 2e-3
        assert np.linalg.norm(estimate.velocity) < 5e-3
    assert live[-1].bias.accelerometer()[2] == pytest.approx(acceleration, abs=0.1)
    assert odometry.recoveries == []


@pytest.mark.parametrize("jerk", [1.0, 2.0])
def test_in_a_lift_that_sets_off_slowly_the_body_stays_too(jerk):
    """It comes to 1 m/s^2: longer than a rest may be open lines say again and again that it goes
    on.
    """
    stream = []
    for measurement in resting_stream(6.0):
        if isinstance(measurement, ImuSample):
            up = np.clip(jerk * (measurement.stamp * 1e-9 - 3.0), 0.0, 1.0)
            felt = measurement.accelerometer + np.array([0.0, 0.0, up])
            measurement = measurement._replace(accelerometer=felt)
        stream.append(measurement)
    odometry, live, smoothed = run(stream, small_stream()[1])
    rest = live[-1].world_T_body
    for estimate in live:
        error = estimate.world_T_body.localCoordinates(rest)
        assert error @ np.linalg.solve(estimate.covariances[0], error) < 16.8  # in 99 % of cases
    for estimate in smoothed:
        assert np.linalg.norm(estimate.world_T_body.localCoordinates(rest)) < 3e-3
    assert live[-1].bias.accelerometer()[2] == pytest.approx(1.0, abs=0.1)
    assert any("images and IMU have disagreed" in warning for warning in odometry.warnings)


def test_a_recording_that_ends_while_a_rest_is_undecided_ends_where_lines_say():
    _, _, smoothed = run(lifted(resting_stream(3.45), 3.05, 1.0), small_stream()[1])
    rest = smoothed[0].world_T_body
    for estimate in smoothed:
        assert np.linalg.norm(estimate.world_T_body.localCoordinates(rest)) < 3e-3


def test_a_rolling_shutter_may_rest_for_long():
    """Longer than measurements are kept for the window alone, with a lift in between."""
    calibration = SMALL.with_readout(0.02)
    _, live, smoothed = run(lifted(resting_stream(5.5), 3.05, 1.0), calibration)
    rest = live[-1].world_T_body
    for estimate in smoothed:
        assert np.linalg.norm(estimate.world_T_body.localCoordinates(rest)) < 3e-3
        assert np.linalg.norm(estimate.velocity) < 5e-3
