# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest
from scipy.stats import f as f_ratio
from scipy.stats import norm, t

from ideal_tracks import MANY
from monitored_window import monitored_window
from ruledgraph.backend.bias_jump import JumpTest
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Innovation
from ruledgraph.core.messages import Messages
from ruledgraph.integrity.gauge import GaugeUncertainty
from ruledgraph.integrity.monitor import IntegrityMonitor
from ruledgraph.integrity.parallel_lines import ParallelLines


def shown(window: Window, monitor: IntegrityMonitor) -> np.ndarray:
    """Covariance of the position as it is reported over that of the window."""
    state, own = window.newest.state, window.newest.covariances
    reported = monitor.covariances(own, state.pose(), state.velocity())
    return reported[0][3:, 3:] - own[0][3:, 3:]


@pytest.mark.parametrize("noise_times", [1.0, 3.0, 1.0 / 3.0])
def test_images_and_imu_that_agree(noise_times):
    window, monitor, warnings = monitored_window(noise_times=noise_times)
    assert warnings == []
    assert not monitor.is_contradicted
    assert not monitor.parallel
    assert np.linalg.eigvalsh(shown(window, monitor)).max() < 0.0


def test_stamps_that_are_off_are_reported():
    _, monitor, warnings = monitored_window(late=0.03)
    assert monitor.is_contradicted
    assert "time offset or extrinsics may be wrong" in warnings[0]


def test_nothing_jumps_while_a_start_is_on_trial_or_many_lines_do_not_fit():
    monitor = IntegrityMonitor(GaugeUncertainty(), Messages(), Config(), on_trial=True)
    assert monitor.jump_threshold == np.inf
    monitor.confirm(0.0)
    assert np.isfinite(monitor.jump_threshold)
    _, misfit, _ = compared(misfits=3)
    assert np.isinf(misfit.jump_threshold)


def test_biases_jump_where_the_innovation_contradicts_and_lines_agree():
    window, monitor, _ = monitored_window()
    window.innovation = Innovation(9e3, 9, window.newest.time - 1.0)
    monitor.update(window, False)
    assert monitor.jump_threshold == -np.inf
    window.innovation = None
    window.jump_test = JumpTest(1.0, np.zeros(6), jumped=True)
    monitor.update(window, False)
    assert np.isfinite(monitor.jump_threshold)


def test_a_jump_is_held_against_the_ratios_before():
    config = Config.model_validate({"integrity": {"variance_memory": 1e4}})
    window, _, _ = monitored_window()
    monitor = IntegrityMonitor(GaugeUncertainty(), Messages(), config)
    window.jump_test = JumpTest(30.0, np.zeros(6), jumped=False)
    for _ in range(20):
        monitor.update(window, False)
        window.newest.time += 0.1
        window.intervals[-1].node.time += 0.1
    limits = config.integrity
    known = limits.variance_prior + 20 * 6
    factor = (limits.variance_prior + 20 * 30.0) / known
    expected = 6.0 * factor * f_ratio.ppf(limits.confidence, 6, known)
    assert monitor.jump_threshold == pytest.approx(expected, rel=1e-3)
    # The first one is of the noise figures alone.
    window.jump_test, fresh = None, IntegrityMonitor(GaugeUncertainty(), Messages(), config)
    fresh.update(window, False)
    alone = 6.0 * f_ratio.ppf(limits.confidence, 6, limits.variance_prior)
    assert fresh.jump_threshold == pytest.approx(alone, rel=1e-6)


def nearly_parallel(degrees: float) -> np.ndarray:
    """Segments of which one half leans to one side by so much, the other to the other."""
    middles, angles = MANY.mean(axis=1), np.radians(degrees) * (-1.0) ** np.arange(len(MANY))
    along = np.column_stack([np.zeros(len(MANY)), np.cos(angles), np.sin(angles)])
    return np.stack([middles - 0.3 * along, middles + 0.3 * along], axis=1)


@pytest.mark.parametrize(("degrees", "is_parallel"), [(5.0, True), (15.0, False)])
def test_lines_are_parallel_when_hardly_any_of_them_is_across(degrees, is_parallel):
    """Of their squared directions 0.8 % and 6.7 %; the limit is 2 %."""
    _, monitor, _ = monitored_window(segments=nearly_parallel(degrees))
    assert monitor.parallel == is_parallel


@pytest.mark.parametrize("elapsed", [1.5, 3.0])
def test_along_parallel_lines_a_wrong_velocity_adds_up(elapsed):
    """Of 0.2 m/s, as it was known when they became parallel, with tilt and bias known well."""
    window, _, _ = monitored_window(segments=nearly_parallel(0.0))
    of_pose, of_velocity, of_bias = window.newest.covariances
    of_pose[:], of_bias[:] = 1e-12 * np.eye(6), 1e-12 * np.eye(6)
    of_velocity[:] = 0.04 * np.eye(3)
    monitor = IntegrityMonitor(GaugeUncertainty(), Messages(), Config())
    for time in (0.0, elapsed):
        window.newest.time += time
        monitor.update(window, False)
    sigma = np.sqrt(np.linalg.eigvalsh(shown(window, monitor))[-1])
    assert sigma == pytest.approx(0.2 * elapsed, rel=1e-3)


@pytest.mark.parametrize(("axis", "drifts"), [("heading", False), ("tilt", True)])
def test_along_parallel_lines_a_tilt_adds_up_and_a_heading_does_not(axis, drifts):
    """A tilt of 0.02 rad feels like 0.2 m/s^2 of gravity, in 3 s 0.6 m."""
    window, _, _ = monitored_window(segments=nearly_parallel(0.0))
    node = window.newest
    R = node.state.attitude().matrix()
    about = R.T @ np.array([0.0, 0.0, 1.0] if axis == "heading" else [1.0, 0.0, 0.0])
    node.covariance = 1e-12 * np.eye(15)
    node.covariance[:3, :3] += 0.02**2 * np.outer(about, about)
    parallel = ParallelLines(Config().integrity)
    parallel.update(window, 1.0)
    node.time += 3.0
    parallel.update(window, 1.0)
    sigma = np.sqrt(np.linalg.eigvalsh(parallel.covariance())[-1])
    assert (sigma > 0.3) == drifts
    assert drifts or sigma < 1e-3


def test_parallel_lines_leave_the_motion_along_them_open():
    """Other lines are needed: covariance grows along them, and across it does not."""
    middles = MANY.mean(axis=1)
    along = np.array([0.3, 1.0, 0.0]) / np.hypot(0.3, 1.0)
    parallel = np.stack([middles - 0.3 * along, middles + 0.3 * along], axis=1)
    window, monitor, warnings = monitored_window(segments=parallel)
    assert warnings == []
    assert monitor.parallel
    R = window.newest.state.attitude().matrix()
    extra = R @ shown(window, monitor) @ R.T
    values, vectors = np.linalg.eigh(extra)
    assert np.sqrt(values[-1]) > 0.05
    assert values[1] < 1e-9
    assert abs(vectors[:, -1] @ along) > 0.98


def compared(misfits: int):
    """A window whose lines were compared: so many of ten lines miss in each of its intervals."""
    window, monitor, warnings = monitored_window()
    for interval in window.intervals:
        interval.compared, interval.misfits = 10, misfits
    monitor.update(window, False)
    return window, monitor, warnings


@pytest.mark.parametrize(
    ("misfits", "disagree", "lost"),
    [(1, False, False), (4, True, False), (5, True, True), (6, True, True)],
)
def test_lines_that_do_not_fit_are_reported(misfits, disagree, lost):
    _, monitor, warnings = compared(misfits)
    assert (monitor.is_contradicted, monitor.lost) == (disagree, lost)
    assert len(warnings) == disagree
    assert not disagree or "of the lines do not fit the estimate" in warnings[0]


@pytest.mark.parametrize(("since", "jumps"), [(-0.1, False), (0.1, True)])
def test_innovations_that_began_before_the_lines_fitted_make_no_jump(since, jumps):
    """They may be of the lines that did not fit."""
    window, monitor, _ = compared(misfits=3)
    window.innovation = Innovation(9e3, 9, window.newest.time + since)
    window.newest.time += 1.0
    for interval in window.intervals:
        interval.misfits = 0
    monitor.update(window, False)
    assert (monitor.jump_threshold == -np.inf) == jumps
    assert jumps or np.isfinite(monitor.jump_threshold)


def test_lines_that_do_not_fit_for_long_are_those_of_a_lost_estimate():
    window, monitor, warnings = compared(misfits=4)
    window.newest.time += 1.0
    window.intervals[-1].node.time += 1.0
    monitor.update(window, False)
    assert monitor.lost
    assert len(warnings) == 1


def test_nobody_looks_at_rest_so_nothing_is_lost_then():
    window, monitor, _ = compared(misfits=4)
    window.newest.time += 1.0
    for interval in window.intervals:
        interval.compared, interval.misfits, interval.still = 0, 0, True
    monitor.update(window, True)
    assert not monitor.lost
    # Two looks far from each other, at lines that fit: the share is of those.
    window.intervals[0].compared = window.intervals[-1].compared = 5
    monitor.update(window, True)
    assert not monitor.lines_misfit


def tell(window: Window, factor: float, later: float = 100.0) -> None:
    """Innovations of very many degrees of freedom at the newest state, so much (s) after the one
    before, by which noise has this variance factor; what came before is forgotten by then.
    """
    window.newest.time += later
    for interval in window.intervals:
        interval.node.time += later
    window.innovation = Innovation(1e9 * factor, 10**9, window.newest.time - 2.5)


@pytest.mark.parametrize("factor", [9.0, 0.5])
def test_covariances_are_those_of_the_window_times_the_variance_factor(factor):
    window, monitor, warnings = monitored_window()
    tell(window, factor)
    monitor.update(window, False)
    state, own = window.newest.state, window.newest.covariances
    reported = monitor.covariances(own, state.pose(), state.velocity())
    for shown_block, own_block in zip(reported, own, strict=True):
        np.testing.assert_allclose(shown_block, factor * own_block, rtol=1e-6)
    assert warnings == []


def test_covariances_have_the_bounds_of_students_t():
    """Of 5 degrees of freedom of the noise figures and 10 of an innovation."""
    window, monitor, _ = monitored_window()
    tell(window, 1.0)
    window.innovation = Innovation(90.0, 10, window.newest.time - 2.5)
    monitor.update(window, False)
    state, own = window.newest.state, window.newest.covariances
    reported = monitor.covariances(own, state.pose(), state.velocity())
    # As likely as three sigma of a Gaussian are 3.586 of Student's t, with 15 degrees of freedom.
    expected = (5.0 + 90.0) / 15.0 * (t.ppf(norm.cdf(3.0), 15) / 3.0) ** 2
    np.testing.assert_allclose(reported[1], expected * own[1], rtol=1e-6)


def test_what_was_wrong_with_the_position_stays():
    """And of velocity it is forgotten."""
    window, monitor, _ = monitored_window()
    for factor in (9.0, 1.0):
        tell(window, factor)
        monitor.update(window, False)
    own = window.newest.covariances
    np.testing.assert_allclose(shown(window, monitor), 8.0 * own[0][3:, 3:], rtol=1e-3)
    state = window.newest.state
    reported = monitor.covariances(own, state.pose(), state.velocity())
    np.testing.assert_allclose(reported[1], own[1], rtol=1e-6)


def test_a_place_that_drifts_on_is_further_off():
    """Each part of its covariance by what was wrong when it came."""
    window, monitor, _ = monitored_window()
    own = 1e4 * window.newest.covariances[0][3:, 3:]  # more than there ever was
    for times, factor in ((1.0, 9.0), (2.0, 4.0), (2.0, 1.0), (1.5, 4.0)):
        window.newest.covariances[0][3:, 3:] = times * own
        tell(window, factor)
        monitor.update(window, False)
    # Nine times the first part, four times the second; nothing was new after that.
    np.testing.assert_allclose(shown(window, monitor), (8.0 + 3.0) * own, rtol=0.01)


def test_covariances_stay_covariances_while_the_body_turns():
    """What is open from before, along one axis, and what is now, along another; a frame between
    states looks elsewhere.
    """
    window, monitor, _ = monitored_window()
    for scale, axes in ((30.0, [1.0, 1e-3, 1e-3]), (20.0, [1e-3, 1.0, 1e-3])):
        window.newest.covariances[0][:] = np.diag([1e-4, 1e-4, 1e-4, *axes])
        tell(window, scale**2)
        monitor.update(window, False)
    state = window.newest.state
    for angle in np.linspace(0.0, np.pi, 7):
        pose = state.pose().compose(gtsam.Pose3(gtsam.Rot3.Rz(angle), np.zeros(3)))
        of_pose = monitor.covariances(window.newest.covariances, pose, state.velocity())[0]
        assert np.linalg.eigvalsh(of_pose)[0] > 0.0
        # At the state no part of either is lost.
        if angle == 0.0:
            assert np.all(of_pose.diagonal()[3:5] > [0.99 * 900.0, 0.99 * 400.0])


def test_an_estimate_that_moves_while_the_body_rests_is_off_by_that():
    window, monitor, warnings = monitored_window()
    node = window.newest
    state, slide = node.state, np.array([0.03, -0.04, 0.0])
    monitor.update(window, True)
    before = shown(window, monitor)
    node.state = gtsam.NavState(state.attitude(), state.position() + slide, state.velocity())
    R = state.attitude().matrix()
    for _ in range(2):
        monitor.update(window, True)
        np.testing.assert_allclose(
            R @ (shown(window, monitor) - before) @ R.T, np.outer(slide, slide), atol=1e-12
        )
    assert len(warnings) == 1
    assert "moved by 0.05 m" in warnings[0]
    # It stays when the rest is over.
    monitor.update(window, False)
    more = shown(window, monitor) - before
    np.testing.assert_allclose(R @ more @ R.T, np.outer(slide, slide), atol=1e-12)


def test_an_estimate_that_moved_until_a_rest_was_known_is_off_by_that():
    window, monitor, _ = monitored_window()
    state, slide = window.newest.state, np.array([0.3, -0.4, 0.1])
    before = shown(window, monitor)
    stayed_at = gtsam.NavState(state.attitude(), state.position() - slide, state.velocity())
    monitor.update(window, True, stayed_at)
    R = state.attitude().matrix()
    more = shown(window, monitor) - before
    np.testing.assert_allclose(R @ more @ R.T, np.outer(slide, slide), atol=1e-12)


@pytest.mark.parametrize(
    ("velocity", "position", "rated"),
    [(0.04, 2.9, "tracking"), (0.06, 0.0, "degraded"), (0.0, 3.1, "degraded")],
)
def test_tracking_means_that_position_and_velocity_are_known_along_every_axis(
    velocity, position, rated
):
    """Up to 0.05 m/s and 3 m, along the axis where they are known least.

    What a gap before the segment has left, 30 m and a turn, does not count.
    """
    turn = gtsam.Rot3.RzRyRx(0.3, -0.8, 1.1).matrix()
    of_pose = 1e-9 * np.eye(6)
    of_pose[3:, 3:] += turn @ np.diag([position**2, 0.0, 0.0]) @ turn.T
    of_velocity = 1e-9 * np.eye(3) + turn @ np.diag([0.0, velocity**2, 0.0]) @ turn.T
    gap = GaugeUncertainty(900.0 * np.eye(3), 0.5, np.array([1.0, 2.0, 3.0]))
    pose, speed = gtsam.Pose3(gtsam.Rot3(turn), [5.0, 1.0, 0.0]), np.array([1.0, 0.5, 0.0])
    for gauge in (GaugeUncertainty(), gap):
        monitor = IntegrityMonitor(gauge, Messages(), Config())
        covariances = gauge.added_to((of_pose, of_velocity, np.eye(6)), pose, speed)
        assert monitor.rated("tracking", covariances, pose, speed) == rated
        assert monitor.rated("still", covariances, pose, speed) == "still"
