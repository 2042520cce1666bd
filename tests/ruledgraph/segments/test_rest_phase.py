# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether a rest goes on, by what image and IMU show of it."""

from types import SimpleNamespace

import gtsam
import numpy as np
import pytest

from ruledgraph.core.config import Config
from ruledgraph.segments.rest_phase import RestPhase

CONFIG = Config()
NODE = SimpleNamespace(
    time=1.0,
    state=gtsam.NavState(gtsam.Rot3.Yaw(0.3), np.array([1.0, 2.0, 3.0]), np.zeros(3)),
    covariances=(1e-6 * np.eye(6), 1e-6 * np.eye(3), 1e-4 * np.eye(6)),
)
LINE_MANAGER = SimpleNamespace(usual_distance=lambda: 3.0)
WINDOW = SimpleNamespace(newest=NODE, rests_since=0.5, solved=1.0, line_manager=LINE_MANAGER)
MOVED = gtsam.NavState(
    gtsam.Rot3.Ypr(0.31, 0.02, -0.01), np.array([1.02, 2.01, 3.05]), np.array([0.3, -0.1, 0.2])
)
PROPAGATED = (2e-6 * np.eye(6), 3e-6 * np.eye(3), 1e-4 * np.eye(6))
NO_ROTATION = gtsam.Pose3()
LINES = np.tile([[1.0, 0.0, 0.1], [0.0, 1.0, -0.2], [0.6, 0.8, 0.0], [0.8, -0.6, 0.3]], (3, 1))
LONGEST = CONFIG.rest.max_undecided_time


class Shown:
    """What image and IMU show; lines have moved by so much, px."""

    def __init__(self, image_rests: bool, imu_rests: bool, moved: float = 0.02) -> None:
        self.image_rests, self.imu_rests = image_rests, imu_rests
        self.moved = np.full(len(LINES), moved)

    def is_still(self, _time: float, rests_since: float) -> bool:
        return self.imu_rests and self.image_is_unmoved(rests_since)

    def image_is_unmoved(self, rests_since: float) -> bool:
        assert rests_since == WINDOW.rests_since
        return self.image_rests

    def lines_moved(self, _since: float):
        return LINES, self.moved

    def is_noise(self, moved) -> bool:
        return bool(np.all(np.abs(moved) < 3.0 * CONFIG.rest.pose_sigma))


def phase(
    shown: Shown, of_state: bool = True, time: float = 1.1, state: gtsam.NavState = MOVED
) -> RestPhase:
    made = RestPhase(shown, 400.0, CONFIG)
    made.of_state = of_state
    made.update(WINDOW, time, state, NO_ROTATION)
    return made


@pytest.mark.parametrize("imu_rests", [True, False])
def test_a_rest_ends_where_the_image_moves(imu_rests):
    moving = phase(Shown(image_rests=False, imu_rests=imu_rests))
    assert not moving.goes_on
    assert not moving.is_undecided
    state, covariances = moving.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is MOVED
    assert covariances is PROPAGATED


def test_it_is_undecided_only_after_a_rest_and_only_so_long():
    imu_alone = Shown(image_rests=True, imu_rests=False)
    assert phase(imu_alone).is_undecided
    assert not phase(imu_alone, of_state=False).is_undecided
    assert phase(imu_alone, time=NODE.time + LONGEST - 0.05).is_undecided
    assert not phase(imu_alone, time=NODE.time + LONGEST + 0.01).is_undecided


@pytest.mark.parametrize("how", ["IMU at rest again", "too long", "last frame"])
@pytest.mark.parametrize("moved", [0.05, 0.3])
def test_lines_decide_what_was_open(how, moved):
    """After 60 mm by the IMU, 8 px at 3 m: lines that moved as at rest say that the body stayed,
    lines that moved by some tenths of a pixel that it is far away.
    """
    shown = Shown(image_rests=True, imu_rests=True)
    made = phase(shown, state=NODE.state)
    assert made.goes_on
    shown.imu_rests = False
    made.update(WINDOW, 1.2, MOVED, NO_ROTATION)
    assert made.is_undecided
    assert not made.goes_on
    shown.moved = np.full(len(LINES), moved)
    shown.imu_rests = how == "IMU at rest again"
    time = NODE.time + (LONGEST + 0.1 if how == "too long" else 0.5)
    made.update(WINDOW, time, MOVED, NO_ROTATION, last=how == "last frame")
    assert not made.is_undecided
    assert made.goes_on == (moved < 0.1)
    assert made.begin_state() == made.goes_on


def test_a_body_that_moves_by_the_imu_begins_to_rest_only_where_lines_say_so():
    for moved, rests in ((0.02, True), (0.3, False)):
        shown = Shown(image_rests=True, imu_rests=True, moved=moved)
        assert phase(shown, of_state=False).goes_on == rests
        assert phase(shown, of_state=False, state=NODE.state).goes_on


def test_at_rest_the_state_is_the_newest_one():
    rest = phase(Shown(image_rests=True, imu_rests=True))
    state, covariances = rest.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is NODE.state
    x = NODE.state.pose().localCoordinates(MOVED.pose())
    assert np.linalg.eigvalsh(covariances[0] - np.outer(x, x))[0] > 0.0


def test_it_is_decided_before_the_window_is_over():
    """Else the segment would end for want of frames that go on coming."""
    short = CONFIG.model_copy(update={"window": CONFIG.window.model_copy(update={"lag": 0.6})})
    for after, undecided in ((0.29, True), (0.31, False)):
        made = RestPhase(Shown(image_rests=True, imu_rests=False), 400.0, short)
        made.of_state = True
        made.update(WINDOW, NODE.time + after, MOVED, NO_ROTATION)
        assert made.is_undecided == undecided


def test_while_it_is_undecided_the_covariance_is_that_of_both_cases_or_more():
    """About the estimate, of a mixture of a body that moved (the estimate) and one that did not."""
    is_undecided = phase(Shown(image_rests=True, imu_rests=False))
    state, covariances = is_undecided.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is MOVED
    rng = np.random.default_rng(0)
    unmoved = MOVED.pose().localCoordinates(NODE.state.pose())
    for share in (0.0, 0.3, 1.0):
        rests = rng.random(20_000) < share
        errors = rng.multivariate_normal(np.zeros(6), PROPAGATED[0], len(rests))
        of_newest = rng.multivariate_normal(unmoved, NODE.covariances[0], len(rests))
        errors = np.where(rests[:, None], of_newest, errors)
        of_mixture = errors.T @ errors / len(rests)
        # 20 000 draws know a variance to 1 %, here to three times that.
        smallest = np.linalg.eigvalsh(1.03 * covariances[0] - of_mixture)[0]
        assert smallest > 0.0
    assert np.allclose(covariances[1], PROPAGATED[1] + np.outer(MOVED.velocity(), MOVED.velocity()))
    assert covariances[2] is PROPAGATED[2]


def test_lines_are_looked_for_where_the_body_has_only_turned_until_the_image_moves():
    for imu_rests in (True, False):
        held = phase(Shown(image_rests=True, imu_rests=imu_rests)).held(MOVED, WINDOW).pose()
        assert held.rotation().equals(MOVED.attitude(), 0.0)
        assert np.array_equal(held.translation(), NODE.state.position())
    moving = phase(Shown(image_rests=False, imu_rests=False)).held(MOVED, WINDOW).pose()
    assert moving.equals(MOVED.pose(), 0.0)


def test_where_lines_deny_a_motion_by_the_imu_covariances_hold_for_a_rest_too():
    """Until lines or the IMU say otherwise, or the rest is known."""
    shown = Shown(image_rests=True, imu_rests=False)
    made = phase(shown, of_state=False)
    assert not made.goes_on
    assert made.stayed_at is NODE.state
    state, covariances = made.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is MOVED
    x = MOVED.pose().localCoordinates(NODE.state.pose())
    assert np.allclose(covariances[0], PROPAGATED[0] + np.outer(x, x))

    shown.moved = np.full(len(LINES), 0.3)
    made.update(WINDOW, 1.2, MOVED, NO_ROTATION)
    assert made.stayed_at is None
    shown.moved = np.full(len(LINES), 0.02)
    made.update(WINDOW, 1.3, MOVED, NO_ROTATION)
    assert made.stayed_at is NODE.state
    made.update(WINDOW, 1.4, NODE.state, NO_ROTATION)
    assert made.stayed_at is None


def test_a_moving_image_denies_no_motion():
    assert phase(Shown(image_rests=False, imu_rests=False), of_state=False).stayed_at is None
