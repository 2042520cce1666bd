# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
import pytest

from ruledgraph.core.line_observations import PluckerEstimate
from ruledgraph.frontend import kernel
from ruledgraph.frontend.edge_batch import Rulings
from ruledgraph.frontend.edge_search import normal_of
from ruledgraph.frontend.ruling_prediction import CameraMotion, by_estimate, by_rotation, predict
from ruledgraph.frontend.track import Track
from ruledgraph_factors import LineChart

needs_native = pytest.mark.skipif(
    kernel.native is None, reason="the native kernel was not built (no C++ compiler)"
)
FOCAL = 300.0
BEFORE = gtsam.Pose3(gtsam.Rot3.Ypr(0.1, -0.05, 0.02), np.array([0.2, -0.1, 0.3]))
NOW = BEFORE.compose(gtsam.Pose3(gtsam.Rot3.Ypr(-0.03, 0.02, 0.01), np.array([0.05, 0.02, -0.1])))
MOTION = CameraMotion(NOW.between(BEFORE).rotation().matrix(), 0.05, BEFORE, NOW)
COVARIANCE = np.diag([1e-6, 4e-6, 2e-6, 1e-6])


def seen(world_T_cam: gtsam.Pose3, points: np.ndarray) -> np.ndarray:
    in_cam = world_T_cam.transformTo(np.asarray(points).T).T
    return in_cam[:, :2] / in_cam[:, 2:]


@dataclass
class Line:
    track: Track
    chart: LineChart
    covariance: np.ndarray

    @property
    def prediction(self) -> PluckerEstimate:
        return PluckerEstimate(*self.chart.plucker(np.zeros(4)), self.covariance)


def random_line(rng: np.random.Generator) -> tuple[Line, np.ndarray]:
    """A line seen before from end to end, and its end points in the world."""
    points = rng.uniform([-1.0, -1.0, 2.0], [1.0, 1.0, 4.0], size=(2, 3))
    track = Track(int(rng.integers(1000)), 0.0, seen(BEFORE, points), 20.0)
    return Line(track, LineChart.from_points(BEFORE, *points), COVARIANCE), points


def estimated(lines: Sequence[Line], otherwise: Rulings) -> Rulings:
    tracks, known = [line.track for line in lines], [line.prediction for line in lines]
    return by_estimate(tracks, known, MOTION, otherwise, FOCAL)


def test_a_known_line_appears_where_its_points_project():
    rng = np.random.default_rng(0)
    lines, points = zip(*(random_line(rng) for _ in range(50)), strict=True)
    rulings = by_rotation([line.track for line in lines], np.eye(3), 0.1, FOCAL)
    predicted = estimated(lines, rulings)
    for own, ends in zip(predicted.ends, points, strict=True):
        np.testing.assert_allclose(own, seen(NOW, ends), atol=1e-9)
    none = by_rotation([], np.eye(3), 0.1, FOCAL)
    assert estimated([], none) is none


@pytest.mark.parametrize("ratio", [0.95, 1.04])
def test_a_longer_focal_length_shows_lines_larger(ratio):
    """Tracks are normalised with the calibration's, the camera has `ratio` times that."""
    rng = np.random.default_rng(0)
    lines, points = zip(*(random_line(rng) for _ in range(20)), strict=True)
    tracks = [Track(n, 0.0, line.track.ends * ratio, 20.0) for n, line in enumerate(lines)]
    turn = gtsam.Rot3.Ypr(0.02, -0.01, 0.03).matrix()
    rulings = by_rotation(tracks, turn, 0.1, FOCAL, ratio)
    for line, ends in zip(lines, rulings.ends, strict=True):
        rays = np.column_stack([line.track.ends, np.ones(2)]) @ turn.T
        np.testing.assert_allclose(ends, ratio * rays[:, :2] / rays[:, 2:], atol=1e-12)
    known = [line.prediction for line in lines]
    predicted = by_estimate(tracks, known, MOTION._replace(focal_ratio=ratio), rulings, FOCAL)
    for own, ends in zip(predicted.ends, points, strict=True):
        np.testing.assert_allclose(own, ratio * seen(NOW, ends), atol=1e-9)


def test_the_sigmas_are_those_of_the_covariance():
    rng = np.random.default_rng(1)
    line, _ = random_line(rng)
    line.covariance = 4.0 * COVARIANCE
    otherwise = by_rotation([line.track], np.eye(3), 0.1, FOCAL)
    (own,) = estimated([line], otherwise).one_by_one()
    offsets = []
    normal = np.array([[0.0, -1.0], [1.0, 0.0]]) @ (own.ends[1] - own.ends[0])
    normal /= np.linalg.norm(normal)
    for _ in range(4000):
        delta = rng.multivariate_normal(np.zeros(4), line.covariance)
        moment, direction = np.split(line.chart.plucker(delta)[0], 2)
        m = NOW.rotation().matrix().T @ (moment - np.cross(NOW.translation(), direction))
        homogeneous = np.column_stack([own.ends, np.ones(2)])
        offsets.append(FOCAL * homogeneous @ m / (normal @ m[:2]))
    # 1.2 px for the motion; 4,000 samples give a deviation to 1.1 %.
    wanted = np.hypot(np.std(offsets, axis=0), 1.2)
    np.testing.assert_allclose(own.sigmas, wanted, rtol=0.05)


def test_a_line_that_was_missed_is_searched_for_more_widely():
    """By half as much again for each frame, once its estimate is precise."""
    line, _ = random_line(np.random.default_rng(5))
    line.covariance = 1e-16 * np.eye(4)
    sigmas = []
    for line.track.misses in range(4):
        otherwise = by_rotation([line.track], np.eye(3), 0.1, FOCAL)
        sigmas.append(estimated([line], otherwise).sigmas[0])
    wanted = 1.2 * 1.5 ** np.arange(4.0)
    np.testing.assert_allclose(sigmas, np.column_stack([wanted, wanted]), rtol=1e-6)


def test_a_line_through_the_camera_stays_with_the_rotation():
    rng = np.random.default_rng(2)
    line, _ = random_line(rng)
    centre = NOW.translation()
    line.chart = LineChart.from_points(BEFORE, centre, centre + np.array([0.3, 0.2, 1.0]))
    otherwise = by_rotation([line.track], np.eye(3), 0.1, FOCAL)
    own = estimated([line], otherwise)
    for mine, other in zip(own, otherwise, strict=True):
        np.testing.assert_array_equal(mine, other)


def test_without_depth_a_track_moves_with_the_rotation_and_on_across_itself():
    turn = gtsam.Rot3.Ypr(0.05, 0.1, -0.2).matrix()
    ends = np.array([[-0.2, 0.1], [0.3, 0.1]])
    track = Track(0, 0.0, ends, 20.0, rates=(30.0, 60.0))
    (still,) = by_rotation([track], np.eye(3), 0.1, FOCAL).one_by_one()
    np.testing.assert_allclose(still.ends - ends, [[0.0, 0.01], [0.0, 0.02]], atol=1e-12)
    track.rates = (0.0, 0.0)
    (turned,) = by_rotation([track], turn, 0.1, FOCAL).one_by_one()
    rays = np.column_stack([ends, np.ones(2)]) @ turn.T
    np.testing.assert_allclose(turned.ends, rays[:, :2] / rays[:, 2:], atol=1e-12)
    assert turned.sigmas == pytest.approx((track.sigma, track.sigma))
    assert by_rotation([], turn, 0.1, FOCAL).ends.shape == (0, 2, 2)


def test_the_rates_of_a_line_in_the_graph_are_those_that_its_estimate_means():
    """From one frame to the next it moves on as `by_rotation` predicts with them."""
    lines = [random_line(np.random.default_rng(seed))[0] for seed in range(20)]
    tracks, known = [line.track for line in lines], {}
    for number, line in enumerate(lines):
        line.track.id, line.track.rates = number, (300.0, -200.0)  # of frames before
        known[number] = line.prediction
    rulings = predict(tracks, known, MOTION, FOCAL)
    again = by_rotation(tracks, MOTION.cam_R_before, MOTION.elapsed, FOCAL)
    off = np.einsum("nei,ni->ne", rulings.ends - again.ends, normal_of(again.ends)) * FOCAL
    moved = np.abs(MOTION.elapsed * np.array([track.rates for track in tracks]))
    # But for terms of the second order: ends move along the line, too, and that turns.
    assert np.abs(off).max() < 0.2
    assert moved.max() > 5.0


@needs_native
def test_kernels_predict_the_same(monkeypatch):
    rng = np.random.default_rng(3)
    lines = [random_line(rng)[0] for _ in range(40)]
    for line in lines[:10]:
        line.covariance = 1e3 * line.covariance
        line.track.misses = int(rng.integers(4))
    # Through the camera's centre, along the ray to one end, behind the camera, far away.
    centre, ahead = NOW.translation(), np.array([0.3, 0.2, 1.0])
    ray = BEFORE.transformFrom(np.append(lines[11].track.ends[0], 1.0)) - BEFORE.translation()
    away = np.array([1e9, 0.0, 0.0])
    for line, first, second in (
        (lines[10], centre, centre + ahead),
        (lines[11], BEFORE.translation() + 1e-6, BEFORE.translation() + ray + 1e-6),
        (lines[12], *(NOW.transformFrom(np.array([x, 0.1, -1.0])) for x in (-1.0, 1.0))),
        (lines[13], away, away + np.array([0.0, 1.0, 0.5])),
    ):
        line.chart = LineChart.from_points(BEFORE, first, second)
    otherwise = by_rotation([line.track for line in lines], np.eye(3), 0.1, FOCAL)
    found = []
    for name in ("native", "numpy"):
        monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
        found.append(estimated(lines, otherwise))
    for mine, other in zip(*(own[:3] for own in found), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-12, atol=1e-12)


def test_a_ruling_is_no_less_sure_than_can_be_searched():
    line, _ = random_line(np.random.default_rng(6))
    line.covariance = 1e4 * np.eye(4)
    otherwise = by_rotation([line.track], np.eye(3), 0.1, FOCAL)
    np.testing.assert_array_equal(estimated([line], otherwise).sigmas, [[8.0, 8.0]])


@needs_native
def test_kernels_turn_the_same(monkeypatch):
    rng = np.random.default_rng(4)
    turn = gtsam.Rot3.Ypr(0.05, 0.1, -0.2).matrix()
    tracks = [
        Track(i, 0.0, ends, 20.0, rates=tuple(rates))
        for i, (ends, rates) in enumerate(
            zip(
                rng.uniform(-0.8, 0.8, (50, 2, 2)),
                rng.normal(scale=50.0, size=(50, 2)),
                strict=True,
            )
        )
    ]
    tracks[0].ends[1] = tracks[0].ends[0]  # without a direction
    found = []
    for name in ("native", "numpy"):
        monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
        found.append(by_rotation(tracks, turn, 0.05, FOCAL).ends)
    np.testing.assert_allclose(*found, rtol=1e-12, atol=1e-12)
