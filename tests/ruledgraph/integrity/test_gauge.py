# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause


import gtsam
import numpy as np
import pytest

from ruledgraph.backend.start import Start
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.integrity.gauge import GaugeUncertainty, ReliableState, continued, yaw_alignment

LIMITS = IntegrityConfig()
MOUNTINGS = (gtsam.Rot3(), gtsam.Rot3.Ry(-np.pi / 2), gtsam.Rot3.Rx(-np.pi / 2))
CERTAIN = (np.eye(6) * 1e-6, np.eye(3) * 1e-6, np.eye(6) * 1e-6)


def start_at(pose: gtsam.Pose3, time: float = 0.0, lines=()) -> Start:
    return Start(
        stamp=0,
        time=time,
        state=gtsam.NavState(pose, np.zeros(3)),
        bias=gtsam.imuBias.ConstantBias(),
        covariance=np.eye(15),
        lines=dict.fromkeys(lines),
    )


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_headings_of_any_mounting(mounting):
    rng = np.random.default_rng(0)
    true = [gtsam.Rot3.Expmap(0.1 * rng.normal(size=3)) * mounting for _ in range(5)]
    ours = [gtsam.Rot3.Yaw(2.5) * R for R in true]
    turn = yaw_alignment(*(np.array([R.matrix() for R in attitudes]) for attitudes in (ours, true)))
    assert turn.yaw() == pytest.approx(2.5)


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_a_segment_continues_where_the_last_one_ended(mounting):
    tilted = gtsam.Rot3.Expmap(np.array([0.05, -0.02, 0.0])) * mounting
    pose = gtsam.Pose3(gtsam.Rot3.Yaw(1.0) * tilted, np.array([1.0, 2.0, 3.0]))
    last = ReliableState(10.0, pose, np.array([0.3, 0.0, 0.0]), CERTAIN)
    fresh = start_at(gtsam.Pose3(gtsam.Rot3.Yaw(-2.0) * tilted, np.array([5.0, 5.0, 5.0])), 10.01)
    start, gauge = continued(fresh, last, LIMITS)
    assert start.state.attitude().equals(pose.rotation(), 1e-6)
    np.testing.assert_allclose(start.state.position(), [1.003, 2.0, 3.0], atol=1e-4)
    assert np.sqrt(np.trace(gauge.position_covariance)) < 0.01


def test_gauge_uncertainty_grows_with_the_gap():
    pose = gtsam.Pose3(gtsam.Rot3.Yaw(1.0), np.array([1.0, 2.0, 3.0]))
    last = ReliableState(10.0, pose, np.array([2.0, 0.0, 0.0]), CERTAIN)
    sigmas = []
    for gap in (0.1, 1.0, 5.0):
        start, gauge = continued(start_at(gtsam.Pose3(), 10.0 + gap), last, LIMITS)
        off = start.state.position() - (pose.translation() + gap * last.velocity)
        # Had it gone on as it went.
        assert off @ np.linalg.solve(gauge.position_covariance, off) < 1.5
        sigmas.append([np.sqrt(np.trace(gauge.position_covariance)), np.sqrt(gauge.yaw_variance)])
    assert np.all(np.diff(sigmas, axis=0) > 0.0)


def test_the_last_velocity_covariance_grows_into_the_position_over_a_gap():
    """p' = p + v t, the covariance of p in the body frame and of v in the world."""
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.5, -0.8, 2.0), np.array([1.0, 2.0, 3.0]))
    R, of_pose = pose.rotation().matrix(), np.diag([1e-6] * 3 + [1e-4, 4e-4, 9e-4])
    of_velocity = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 0.01]])
    last = ReliableState(10.0, pose, np.zeros(3), (of_pose, of_velocity, np.eye(6)))
    certain = IntegrityConfig(gap_acceleration=0.0, gap_rotation_rate=0.0)
    _, gauge = continued(start_at(gtsam.Pose3(), 12.0), last, certain)
    np.testing.assert_allclose(
        gauge.position_covariance, R @ of_pose[3:, 3:] @ R.T + 4.0 * of_velocity
    )
    assert gauge.yaw_variance == pytest.approx(1e-6)


def test_gauge_uncertainty_by_the_settings_of_a_gap():
    last = ReliableState(10.0, gtsam.Pose3(), np.zeros(3), tuple(0.0 * c for c in CERTAIN))
    _, gauge = continued(start_at(gtsam.Pose3(), 12.0), last, LIMITS)
    # Half an acceleration of 1 m/s^2 over 2 s, and a turn of 0.3 rad/s.
    np.testing.assert_allclose(gauge.position_covariance, 4.0 * np.eye(3))
    assert gauge.yaw_variance == pytest.approx(0.36)


def test_gauge_uncertainty_in_covariances():
    """By many worlds that are off as it says."""
    rng = np.random.default_rng(0)
    pose = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.5, -0.8, 2.0), np.array([3.0, 1.0, 0.5]))
    velocity, position = np.array([1.0, 2.0, 0.0]), np.diag([1e-4, 4e-4, 1e-6])
    gauge = GaugeUncertainty(position, 1e-4, np.array([1.0, 0.0, 0.0]))
    of_pose, of_velocity, _ = gauge.added_to(CERTAIN, pose, velocity)
    errors, changes = [], []
    for _ in range(20_000):
        turn = gtsam.Rot3.Yaw(1e-2 * rng.normal())
        shift = rng.multivariate_normal(np.zeros(3), position) + gauge.pivot
        world = gtsam.Pose3(turn, shift - turn.rotate(gauge.pivot))
        errors.append(pose.localCoordinates(world * pose))
        changes.append(turn.rotate(velocity) - velocity)
    np.testing.assert_allclose(np.cov(np.array(errors).T), of_pose, atol=2e-5)
    np.testing.assert_allclose(np.cov(np.array(changes).T), of_velocity, atol=2e-5)
