# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The time offset from how images turn: points of a made-up scene, seen by a shaken camera."""

import dataclasses
import itertools

import gtsam
import numpy as np
import pytest

from ruledgraph.calibration.rig import Calibration
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.mounting_check import check_mounting
from ruledgraph.initialization.row_delays import at_middle_row
from ruledgraph.initialization.time_offset_finder import TimeOffsetFinder, covered, fit_offset
from ruledgraph.simulation import D435I
from ruledgraph_factors import ImuSamples

BIAS_SIGMA = 0.1
# Seconds, images and gyroscope samples a second, points, px of noise.
LENGTH, FRAMES, RATE, POINTS, NOISE = 1.4, 20.0, 200.0, 60, 0.2
# Four times the root mean square over 15 seeds with rates of 1 rad/s, rad.
MOUNTING_ERROR = 4.0 * np.radians(0.17)
BIAS = np.array([0.02, -0.05, 0.04])


def shaken(seed: int, offset: float, size: float = 0.3) -> tuple[PointPairs, ImuSamples]:
    """A camera turned and carried by hand; images are taken `offset` after their stamps.

    Args:
        seed: of all randomness.
        offset: t_imu - t_cam, s.
        size: of the rates, rad/s.
    """
    rng = np.random.default_rng(seed)
    waves = rng.uniform(0.5, 4.0, (3, 3)), rng.uniform(0.0, 2.0 * np.pi, (3, 3))
    carried = rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.3, 0.3, 3)

    def rate(t: float) -> np.ndarray:
        return size * np.cos(2.0 * np.pi * waves[0] * t + waves[1]).mean(axis=1)

    fine = np.arange(0.0, LENGTH + 0.5, 5e-4)
    poses, pose = [], gtsam.Rot3()
    for t in fine:
        poses.append(pose)
        pose = pose.compose(gtsam.Rot3.Expmap(rate(t + 2.5e-4) * 5e-4))
    times = np.arange(0.0, LENGTH + 0.45, 1.0 / RATE)
    noise = D435I.imu_noise.gyroscope * np.sqrt(RATE)
    gyroscope = (
        np.array([rate(t) for t in times]) + BIAS + rng.normal(scale=noise, size=(len(times), 3))
    )
    samples = ImuSamples(times, gyroscope, np.zeros_like(gyroscope))
    stamps = np.arange(0.2, LENGTH + 0.2, 1.0 / FRAMES)
    body_R_cam = D435I.body_T_cam.rotation()

    def camera(stamp: float) -> gtsam.Pose3:
        t = stamp + offset
        at = carried[0] * t + carried[1] * t * t
        return gtsam.Pose3(poses[round(t / 5e-4)].compose(body_R_cam), at)

    before, after = [], []
    for first, second in itertools.pairwise(stamps):
        one, other = camera(first), camera(second)
        in_one = rng.uniform([-1.0, -0.6, 1.0], [1.0, 0.6, 1.0], (POINTS, 3))
        in_one = in_one * rng.uniform(1.0, 4.0, (POINTS, 1))
        in_other = np.array([other.transformTo(one.transformFrom(p)) for p in in_one])
        for rays, points in ((before, in_one), (after, in_other)):
            seen = points[:, :2] / points[:, 2:]
            seen += rng.normal(scale=NOISE / D435I.camera.focal_length, size=seen.shape)
            ray = np.hstack([seen, np.ones((POINTS, 1))])
            rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
    pairs = PointPairs(
        np.stack([stamps[:-1], stamps[1:]], axis=1), np.array(before), np.array(after)
    )
    return pairs, samples


def found(seed: int, offset: float, calibration: Calibration = D435I, size: float = 0.3):
    pairs, samples = shaken(seed, offset, size)
    known = covered(pairs, samples, calibration.time_offset)
    return fit_offset(known, samples, calibration, BIAS_SIGMA)


@pytest.mark.parametrize("offset", [-0.06, -0.03, -0.005, 0.0, 0.03, 0.06])
@pytest.mark.parametrize("seed", range(3))
def test_the_offset_is_found(seed, offset):
    """Within three reported standard deviations; and the bias."""
    result = found(seed, offset)
    assert result is not None
    assert result.sigma < 0.006  # of which 5 ms are what a rolling shutter may leave out
    assert abs(result.value - offset) < 0.006
    np.testing.assert_allclose(result.gyroscope_bias, BIAS, atol=0.02)


def test_it_counts_from_the_calibration():
    """A calibration of 50 ms leaves -50 to 150 ms to be searched."""
    known = dataclasses.replace(D435I, time_offset=0.05)
    result = found(1, 0.11, known)
    assert abs(result.value - 0.11) < 3.0 * result.sigma
    assert found(1, -0.06, known) is None


@pytest.mark.parametrize("seed", range(6))
def test_what_does_not_turn_tells_nothing(seed):
    """Noise of the gyroscope and of the points matches somewhere, but not significantly."""
    assert found(seed, 0.02, size=0.0) is None


@pytest.mark.parametrize("axis", range(3))
def test_a_mounting_a_little_off_does_not_disturb_it_and_is_seen(axis):
    """One degree, as of a calibration by hand."""
    off = np.radians(1.0) * np.eye(3)[axis]
    pose = D435I.body_T_cam
    wrong = gtsam.Pose3(pose.rotation() * gtsam.Rot3.Expmap(-off), pose.translation())
    result = found(4, -0.04, dataclasses.replace(D435I, body_T_cam=wrong), size=1.0)
    assert abs(result.value + 0.04) < 3.0 * result.sigma
    assert np.all(np.abs(result.mounting - off) < MOUNTING_ERROR)


def test_a_mounting_the_wrong_way_round_is_seen():
    pairs, samples = shaken(3, -0.03, size=1.0)
    pose = D435I.body_T_cam
    quarter = gtsam.Rot3.Expmap(np.array([0.0, 0.0, 0.5 * np.pi]))
    for rotation, is_wrong in ((pose.rotation(), False), (pose.rotation() * quarter, True)):
        mounted = gtsam.Pose3(rotation, pose.translation())
        calibration = dataclasses.replace(D435I, body_T_cam=mounted)
        known = covered(pairs, samples, 0.0)
        check = check_mounting(known, samples, calibration, BIAS_SIGMA)
        assert check is not None
        assert check.wrong == is_wrong


@pytest.mark.parametrize("axes", [[-1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]], ids=["one", "all"])
def test_an_imu_with_left_handed_axes_is_seen(axes):
    """Rates of axes of which one is reversed, and of a gyroscope of the other sign."""
    pairs, samples = shaken(3, -0.03, size=1.0)
    reversed_ = ImuSamples(samples.times, samples.gyroscope * axes, samples.accelerometer)
    known = covered(pairs, reversed_, 0.0)
    check = check_mounting(known, reversed_, D435I, BIAS_SIGMA)
    assert check.wrong
    assert check.is_mirrored
    assert "right-handed" in check.message(from_images=False)


def test_too_few_images_tell_nothing():
    finder = TimeOffsetFinder(D435I, BIAS_SIGMA)
    _, samples = shaken(0, 0.0)
    rng = np.random.default_rng(0)
    size = D435I.camera.height, D435I.camera.width
    for i in range(4):
        finder.add_image(0.2 + 0.05 * i, rng.integers(0, 255, size, dtype=np.uint8))
    assert finder.find(samples) is None


def test_rays_of_a_rolling_shutter_are_turned_to_the_middle_row():
    """Points of a turning camera, each seen at its row's time, against those of a global shutter.

    The gyroscope's rate changes linearly between samples, as the trapezoidal rule takes it.
    """
    rolling = D435I.with_readout(0.03)
    times, offset = np.arange(0.0, 1.0, 0.005), 0.02
    rate = np.array([1.5, -2.0, 2.5])
    samples = ImuSamples(times, np.tile(rate, (len(times), 1)), np.zeros((len(times), 3)))
    body_R_cam = rolling.body_T_cam.rotation().matrix()
    rng = np.random.default_rng(0)
    scene = np.column_stack([rng.uniform([-0.5, -0.4], [0.5, 0.4], (20, 2)), np.ones(20)])
    scene /= np.linalg.norm(scene, axis=1, keepdims=True)

    def seen(t: float) -> np.ndarray:
        """From the world, which is the camera at 0.4 s."""
        world_R_cam = body_R_cam.T @ gtsam.Rot3.Expmap(rate * (t - 0.4)).matrix() @ body_R_cam
        return scene @ world_R_cam

    def rolled(middle: float) -> np.ndarray:
        exposed = np.full(20, middle)
        for _ in range(20):
            rays = np.array([seen(t)[i] for i, t in enumerate(exposed)])
            rows = rolling.camera.project(rays)[:, 1]
            exposed = middle + rows * rolling.line_delay - 0.5 * rolling.readout
        return rays

    stamps = np.array([[0.36, 0.41]])  # of the middle rows, on the camera's clock
    middles = stamps[0] + offset
    pairs = PointPairs(stamps, *(rolled(t)[None] for t in middles))
    straight = at_middle_row(pairs, samples, rolling, offset)
    for rays, raw, t in zip(straight[1:], pairs[1:], middles, strict=True):
        np.testing.assert_allclose(rays[0], seen(t), rtol=0.0, atol=1e-9)
        assert np.abs(raw[0] - seen(t)).max() > 5.0 / 385.0  # px
    missing = PointPairs(stamps, *(np.zeros((1, 20, 3)) for _ in range(2)))
    assert not np.any(at_middle_row(missing, samples, rolling, offset).before)
