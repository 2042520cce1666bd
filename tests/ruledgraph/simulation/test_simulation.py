# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Streams of simulated measurements and what is true of them."""

from dataclasses import replace
from itertools import islice

import cv2
import gtsam
import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.simulation import (
    D435I,
    PERFECT,
    SCENES,
    ImageQuality,
    Scene,
    Simulation,
    make_scene,
    simulate,
)
from ruledgraph_factors import ImuSamples, preintegrate_frames


@pytest.fixture(scope="module")
def square() -> Scene:
    return make_scene("square")


def small(simulation: Simulation) -> Simulation:
    """The same with an eighth of the pixels."""
    camera = CameraModel(224, 168, 135.0, 135.0, 111.6, 83.4)
    return replace(simulation, calibration=replace(simulation.calibration, camera=camera))


def test_stream_is_in_order_and_complete(square: Scene) -> None:
    simulation = small(simulate(square, "linear-parallel", duration=1.0))
    measurements = list(simulation.stream())
    stamps = [measurement.stamp for measurement in measurements]
    assert stamps == sorted(stamps)
    frames = [m for m in measurements if isinstance(m, Frame)]
    samples = [m for m in measurements if isinstance(m, ImuSample)]
    assert (len(frames), len(samples)) == (90, 201)
    assert {(f.image.shape, f.image.dtype) for f in frames} == {((168, 224), np.dtype(np.uint8))}
    assert np.all(np.abs(np.diff([f.stamp for f in frames]) - 1e9 / 90.0) <= 1.0)
    # The IMU covers the frames.
    assert samples[0].stamp < frames[0].stamp < frames[-1].stamp < samples[-1].stamp


def test_same_seed_same_bytes_other_seed_others() -> None:
    def first_bytes(seed: int) -> list[bytes]:
        simulation = small(simulate("noncoplanar_cluttered", "free", seed=seed, moving_start=True))
        frames = [frame.image.tobytes() for frame in simulation.frames([0, 40])]
        samples = islice(simulation.imu.samples(), 3)
        return frames + [s.gyroscope.tobytes() + s.accelerometer.tobytes() for s in samples]

    first = first_bytes(5)
    assert first == first_bytes(5)
    assert all(a != b for a, b in zip(first, first_bytes(6), strict=True))


@pytest.mark.parametrize("scene", SCENES)
def test_lines_show_as_edges_in_the_frames(scene: str) -> None:
    """Along most of the projected lines there is a step in brightness, at the right place."""
    simulation = simulate(scene, "free", quality=PERFECT, moving_start=True, seed=2)
    frame = next(simulation.frames([30]))
    time = simulation.frame_times()[30]
    pose = simulation.motion.pose(time) * simulation.calibration.body_T_cam
    image = cv2.GaussianBlur(frame.image.astype(np.float32), (0, 0), 0.8)
    gradient = np.hypot(cv2.Sobel(image, -1, 1, 0), cv2.Sobel(image, -1, 0, 1)) / 8.0
    camera = simulation.calibration.camera
    seen = shown = 0
    main = slice(16) if scene.startswith("square") else slice(None)
    for ends in simulation.lines[main]:
        points = ends[0] + np.linspace(0.1, 0.9, 30)[:, None] * (ends[1] - ends[0])
        in_cam = np.array([pose.transformTo(point) for point in points])
        if in_cam[:, 2].min() < 0.3:
            continue
        pixels = camera.project(in_cam)
        if np.any(pixels < 5) or np.any(pixels > np.array([camera.width, camera.height]) - 6):
            continue
        if np.linalg.norm(pixels[-1] - pixels[0]) < 25:
            continue
        column, row = np.round(pixels).astype(int).T
        seen += 1
        shown += np.median(gradient[row, column]) > 2.0
    assert seen >= 4
    # The others are hidden, in the dark, or the bottom edges of what stands on the floor.
    assert shown / seen > 0.5


def test_frames_agree_with_the_truth_under_blur_and_noise(square: Scene) -> None:
    """The dark slats are where the ground truth says: the mean of a few frames' edge offsets."""
    simulation = simulate(square, "circular-tilted-rot-z", moving_start=True, seed=3)
    truth = simulation.ground_truth
    camera = simulation.calibration.camera
    offsets = []
    for number, frame in zip(range(0, 300, 30), simulation.frames(range(0, 300, 30)), strict=True):
        assert frame.stamp == truth.stamps[number]
        body = gtsam.Pose3(gtsam.Rot3(truth.rotation[number]), truth.position[number])
        pose = body * simulation.calibration.body_T_cam
        # Both long edges of the left slat, crossed in rows.
        index = [simulation.line_names.index(f"left.{side}") for side in ("left", "right")]
        for sign, ends in zip((-1.0, 1.0), simulation.lines[index], strict=True):
            points = ends[0] + np.linspace(0.2, 0.8, 40)[:, None] * (ends[1] - ends[0])
            pixels = camera.project([pose.transformTo(point) for point in points])
            across = np.arange(-4, 5)
            row = pixels[:, 1, None] + 0.0 * across
            at = (pixels[:, 0, None] + across).astype(np.float32), row.astype(np.float32)
            profile = cv2.remap(frame.image.astype(np.float32), *at, cv2.INTER_LINEAR).mean(axis=0)
            step = np.maximum(sign * np.diff(profile), 0.0)
            offsets.append(float(step @ (across[:-1] + 0.5) / step.sum()))
    assert abs(np.mean(offsets)) < 0.03
    assert np.abs(offsets).max() < 0.12


def test_truth_is_what_the_ideal_imu_integrates_to(square: Scene) -> None:
    simulation = simulate(square, "free", imu=None, imu_rate=1000.0, moving_start=True)
    samples = list(simulation.imu.samples())
    times = (np.array([s.stamp for s in samples]) - simulation.epoch) * 1e-9
    imu = ImuSamples(times, [s.gyroscope for s in samples], [s.accelerometer for s in samples])
    truth = simulation.truth(simulation.stamps([0.0, 2.0]))
    moved = preintegrate_frames(imu, 0.0, [2.0])
    state = gtsam.NavState(gtsam.Rot3(truth.rotation[0]), truth.position[0], truth.velocity[0])
    pose = moved.poses(state, gtsam.imuBias.ConstantBias())[0]
    np.testing.assert_allclose(pose.translation(), truth.position[1], atol=1e-4)
    np.testing.assert_allclose(pose.rotation().matrix(), truth.rotation[1], atol=1e-5)


def test_true_bias_is_what_separates_the_samples_from_the_ideal(square: Scene) -> None:
    noisy = simulate(square, "walk", seed=4)
    ideal = simulate(square, "walk", imu=None)
    pairs = list(zip(noisy.imu.samples(), ideal.imu.samples(), strict=True))
    error = np.array(
        [
            np.hstack([a.accelerometer - b.accelerometer, a.gyroscope - b.gyroscope])
            for a, b in pairs
        ]
    )
    bias = noisy.truth([a.stamp for a, _ in pairs]).bias
    assert np.ptp(bias, axis=0).min() > 1e-6
    white = error - bias
    expected = np.repeat([1.47e-3, 2.44e-4], 3) * np.sqrt(200.0)
    np.testing.assert_allclose(white.std(axis=0), expected, rtol=0.1)
    assert np.all(np.abs(white.mean(axis=0)) < 4.0 * expected / np.sqrt(len(white)))
    assert not ideal.truth(ideal.stamps([0.0, 5.0])).bias.any()


def test_camera_clock_is_behind_by_the_time_offset(square: Scene) -> None:
    calibration = replace(D435I, time_offset=0.007)
    simulation = simulate(square, "free", calibration=calibration)
    frame = next(simulation.frames([10]))
    assert frame.stamp + 7_000_000 == simulation.ground_truth.stamps[10]
    same = next(simulate(square, "free").frames([10]))
    assert np.array_equal(frame.image, same.image)


def test_dropped_frames_are_missing_and_the_others_the_same(square: Scene) -> None:
    whole = small(simulate(square, "free", duration=1.0))
    lossy = replace(whole, quality=ImageQuality(dropped=0.3))
    kept = {frame.stamp: frame.image for frame in lossy.frames()}
    frames = list(whole.frames())
    assert 45 < len(kept) < 80
    for frame in frames:
        if frame.stamp in kept:
            assert np.array_equal(kept[frame.stamp], frame.image)


def test_noise_has_the_variance_asked_for(square: Scene) -> None:
    quality = ImageQuality(photon_noise=0.05, read_noise=2.0, gain_drift=0.0)
    simulation = simulate(square, "linear-parallel", quality=quality)
    still = np.array([frame.image for frame in simulation.frames(range(60))], dtype=float)
    expected = 0.05 * still.mean(axis=0) + 4.0 + 1.0 / 12.0
    middle = slice(100, 380), slice(100, 540)
    ratio = still.var(axis=0, ddof=1)[middle].mean() / expected[middle].mean()
    assert ratio == pytest.approx(1.0, abs=0.02)


def test_gain_changes_slowly_or_in_steps(square: Scene) -> None:
    def means(quality: ImageQuality) -> np.ndarray:
        simulation = small(simulate(square, "linear-parallel", quality=quality, rate=5.0))
        return np.array([frame.image.mean() for frame in simulation.frames(range(5))])

    constant = means(PERFECT)
    assert np.ptp(constant) == 0.0
    assert 0.0 < np.ptp(means(replace(PERFECT, gain_drift=0.2))) < 0.1 * constant.mean()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, r"^rate = 0.0 Hz is not positive$"),
        ({"imu_rate": float("nan")}, r"^imu_rate = nan Hz is not positive$"),
        ({"quality": ImageQuality(exposure=0.02)}, r"^an exposure of 0.02 s does not fit between"),
    ],
)
def test_figures_out_of_range_are_refused(square: Scene, options, message: str) -> None:
    with pytest.raises(RuledgraphError, match=message):
        simulate(square, "free", **options)


def test_unknown_scene_and_bad_quality_are_refused() -> None:
    with pytest.raises(RuledgraphError, match=r"^unknown scene 'garden'; use one of square, "):
        simulate("garden", "free")
    with pytest.raises(RuledgraphError, match=r"^image quality: read_noise = -1.0 is negative"):
        ImageQuality(read_noise=-1.0)
    with pytest.raises(RuledgraphError, match="dropped and vignetting must be below 1"):
        ImageQuality(dropped=1.0)


def test_an_hour_starts_at_once_and_can_be_asked_anywhere(square: Scene) -> None:
    simulation = small(simulate(square, "walk", duration=3600.0))
    frame = next(simulation.frames([300_000]))
    truth = simulation.truth([frame.stamp])
    assert truth.position[0, 0] == pytest.approx(
        simulation.motion.position((300_000 + 0.5) / 90.0)[0], abs=1e-6
    )
