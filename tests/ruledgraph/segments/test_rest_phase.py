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
WINDOW = SimpleNamespace(newest=NODE, rests_since=0.5, solved=1.0)
MOVED = gtsam.NavState(
    gtsam.Rot3.Ypr(0.31, 0.02, -0.01), np.array([1.02, 2.01, 3.05]), np.array([0.3, -0.1, 0.2])
)
PROPAGATED = (2e-6 * np.eye(6), 3e-6 * np.eye(3), 1e-4 * np.eye(6))


class Shown:
    """What image and IMU show."""

    def __init__(self, image_rests: bool, imu_rests: bool) -> None:
        self.image_rests, self.imu_rests = image_rests, imu_rests

    def is_still(self, _time: float, rests_since: float) -> bool:
        return self.imu_rests and self.image_is_unmoved(rests_since)

    def image_is_unmoved(self, rests_since: float) -> bool:
        assert rests_since == WINDOW.rests_since
        return self.image_rests


def phase(shown: Shown, of_state: bool = True, time: float = 1.1) -> RestPhase:
    made = RestPhase(shown, CONFIG)
    made.of_state = of_state
    made.look(WINDOW, time)
    return made


@pytest.mark.parametrize("imu_rests", [True, False])
def test_a_rest_ends_where_the_image_moves(imu_rests):
    moving = phase(Shown(image_rests=False, imu_rests=imu_rests))
    assert not moving.goes_on
    assert not moving.is_open
    state, covariances = moving.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is MOVED
    assert covariances is PROPAGATED


def test_it_is_open_only_after_a_rest_and_only_so_long():
    imu_alone = Shown(image_rests=True, imu_rests=False)
    assert phase(imu_alone).is_open
    assert not phase(imu_alone, of_state=False).is_open
    longest = CONFIG.rest.solve_interval
    assert phase(imu_alone, time=NODE.time + longest - 0.05).is_open
    assert not phase(imu_alone, time=NODE.time + longest).is_open


def test_at_rest_the_state_is_the_newest_one():
    rest = phase(Shown(image_rests=True, imu_rests=True))
    state, covariances = rest.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is NODE.state
    assert covariances is NODE.covariances


def test_while_it_is_open_the_covariance_is_that_of_both_cases_or_more():
    """About the estimate, of a mixture of a body that moved (the estimate) and one that did not."""
    is_open = phase(Shown(image_rests=True, imu_rests=False))
    state, covariances = is_open.estimate(WINDOW, MOVED, PROPAGATED)
    assert state is MOVED
    rng = np.random.default_rng(0)
    unmoved = MOVED.pose().localCoordinates(NODE.state.pose())
    for share in (0.0, 0.3, 1.0):
        rests = rng.random(20_000) < share
        errors = rng.multivariate_normal(np.zeros(6), PROPAGATED[0], len(rests))
        errors += rests[:, None] * unmoved
        of_mixture = errors.T @ errors / len(rests)
        # 20 000 draws know a variance to 1 %, here to three times that.
        smallest = np.linalg.eigvalsh(1.03 * covariances[0] - of_mixture)[0]
        assert smallest > 0.0
    assert np.allclose(covariances[1], PROPAGATED[1] + np.outer(MOVED.velocity(), MOVED.velocity()))
    assert covariances[2] is PROPAGATED[2]


def test_lines_are_looked_for_where_the_body_has_only_turned_until_the_image_moves():
    for imu_rests in (True, False):
        held = phase(Shown(image_rests=True, imu_rests=imu_rests)).held(MOVED.pose(), WINDOW)
        assert held.rotation().equals(MOVED.attitude(), 0.0)
        assert np.array_equal(held.translation(), NODE.state.position())
    moving = phase(Shown(image_rests=False, imu_rests=False)).held(MOVED.pose(), WINDOW)
    assert moving.equals(MOVED.pose(), 0.0)
