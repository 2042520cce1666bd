# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The faults do what they say, and nothing else."""

import numpy as np
import pytest

import fault_images
import faults
from recordings import SECOND, T0, fields, sequence
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.simulation import D435I

STREAM = sequence(4.0, frame_rate=25)
FRAMES = [m for m in STREAM if isinstance(m, Frame)]
SAMPLES = [m for m in STREAM if isinstance(m, ImuSample)]


def stamps(measurements, kind):
    return [m.stamp for m in measurements if isinstance(m, kind)]


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(fields(a), fields(b), strict=True))


def test_lost_frames():
    kept = list(faults.drop_frames(0.3)(STREAM))
    assert stamps(kept, ImuSample) == stamps(STREAM, ImuSample)
    assert 0.5 < len(stamps(kept, Frame)) / len(FRAMES) < 0.9
    assert stamps(kept, Frame) == stamps(faults.drop_frames(0.3)(STREAM), Frame)
    assert stamps(kept, Frame) != stamps(faults.drop_frames(0.3, seed=1)(STREAM), Frame)


def test_a_silent_imu():
    kept = list(faults.silent_imu(1.0, 0.5)(STREAM))
    assert stamps(kept, Frame) == stamps(STREAM, Frame)
    lost = set(stamps(STREAM, ImuSample)) - set(stamps(kept, ImuSample))
    assert (min(lost), max(lost), len(lost)) == (T0 + SECOND, T0 + 149 * SECOND // 100, 50)
    again = list(faults.silent_imu(1.0, 0.1, every=1.0)(STREAM))
    assert len(SAMPLES) - len(stamps(again, ImuSample)) == 30


@pytest.mark.parametrize(
    "fault",
    [faults.swapped(0.2), faults.late(Frame, 0.3, 0.5), faults.late(ImuSample, 0.1, 0.5)],
    ids=["swapped", "late frames", "late samples"],
)
def test_disorder_loses_nothing(fault):
    given = list(fault(STREAM))
    assert sorted((m.stamp, type(m).__name__) for m in given) == sorted(
        (m.stamp, type(m).__name__) for m in STREAM
    )
    assert [m.stamp for m in given] != [m.stamp for m in STREAM]


@pytest.mark.parametrize("seconds", [-0.02, 0.013])
def test_shifted_stamps_stay_in_order(seconds):
    given = list(faults.shifted_frames(seconds)(STREAM))
    assert [m.stamp for m in given] == sorted(m.stamp for m in given)
    shift = round(seconds * SECOND)
    assert stamps(given, Frame) == [stamp + shift for stamp in stamps(STREAM, Frame)]
    assert stamps(given, ImuSample) == stamps(STREAM, ImuSample)


def test_saturation_and_spikes():
    given = [m for m in faults.saturated(0.1, 9.8)(STREAM) if isinstance(m, ImuSample)]
    assert max(np.abs(m.gyroscope).max() for m in given) == 0.1
    assert max(np.abs(m.accelerometer).max() for m in given) == 9.8
    given = [m for m in faults.spikes(0.05, 3.0)(STREAM) if isinstance(m, ImuSample)]
    assert 5 < sum(not same(a, b) for a, b in zip(given, SAMPLES, strict=True)) < 40


@pytest.mark.parametrize("kind", [Frame, ImuSample])
def test_a_frozen_sensor(kind):
    given = list(faults.repeated(kind, 1.0, 1.0)(STREAM))
    assert [m.stamp for m in given] == [m.stamp for m in STREAM]
    frozen = [m for m in given if isinstance(m, kind) and 1.0 <= (m.stamp - T0) / 1e9 < 2.0]
    first, *others = (fields(m)[1:] for m in frozen)
    assert all(np.array_equal(first, other) for other in others)
    others = [(a, b) for a, b in zip(given, STREAM, strict=True) if not same(a, b)]
    assert len(others) == len(frozen)


def test_images_change_only_in_their_time():
    image = np.full((48, 64), 100, np.uint8)
    stream = [Frame(m.stamp, image) if isinstance(m, Frame) else m for m in STREAM]
    for change in (
        fault_images.exposure_jumps((0.5,), 1.0),
        fault_images.covered(),
        fault_images.moving_object(),
        fault_images.overlay(),
        fault_images.textured_rectangle(),
    ):
        given = list(fault_images.of_images(change, 1.0, 1.0)(stream))
        for m in given:
            if isinstance(m, Frame):
                changed = not np.array_equal(m.image, image)
                assert changed == (1.0 <= (m.stamp - T0) / 1e9 < 2.0)
    dot = np.zeros((48, 64), np.uint8)
    dot[24, 32] = 250
    smeared = fault_images.blurred(9)(dot, 0.0)
    assert (smeared > 0).sum() == 9
    assert smeared[24, 28:37].min() > 20


def test_the_board_covers_a_third_and_moves():
    image = np.full((48, 90), 100, np.uint8)
    board = fault_images.moving_object()
    covers = [np.flatnonzero((board(image, time) != 100).any(axis=0)) for time in (0.0, 1.0, 2.0)]
    assert all(29 <= len(columns) <= 31 for columns in covers)
    assert [columns[0] for columns in covers] == pytest.approx([0, 13.5, 27], abs=1)


def test_the_poster_drifts_and_the_overlay_does_not():
    image = np.full((50, 100), 1, np.uint8)
    poster = fault_images.textured_rectangle(0.6, 0.6, speed=0.1)
    covers = [np.argwhere(poster(image, time) != 1) for time in (0.0, 1.0)]
    assert [cover[:, 1].min() for cover in covers] == [0, 10]
    assert [cover[:, 1].max() - cover[:, 1].min() for cover in covers] == [59, 59]
    assert [cover[:, 0].max() - cover[:, 0].min() for cover in covers] == [29, 29]
    overlay = fault_images.overlay()
    np.testing.assert_array_equal(overlay(image, 0.0), overlay(image, 5.0))
    assert 0.01 < np.mean(overlay(image, 0.0) != 1) < 0.5


def test_biases_that_change():
    given = [m for m in faults.bias_step(1.0, 0.3, 0.02)(STREAM) if isinstance(m, ImuSample)]
    for m, before in zip(given, SAMPLES, strict=True):
        time = max((m.stamp - T0) / 1e9 - 1.0, 0.0)
        there = 0.3 if m.stamp >= T0 + SECOND else 0.0
        assert np.linalg.norm(m.accelerometer - before.accelerometer) == pytest.approx(there)
        assert np.linalg.norm(m.gyroscope - before.gyroscope) == pytest.approx(0.02 * time)


def test_a_lift_ends_as_fast_as_it_began():
    still = [
        m._replace(accelerometer=np.array([0.0, 6.0, 8.0])) if isinstance(m, ImuSample) else m
        for m in STREAM
    ]
    given = [m for m in faults.lift(1.0, 0.5, 2.0)(still) if isinstance(m, ImuSample)]
    felt = np.array([m.accelerometer - [0.0, 6.0, 8.0] for m in given])
    np.testing.assert_allclose(felt.sum(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(felt[120], [0, 0.3, 0.4])
    assert (np.abs(felt).max(axis=1) > 0.0).sum() == 100


def test_calibrations():
    pose = D435I.body_T_cam
    turned = faults.turned_camera(D435I, 2.0).body_T_cam
    assert np.degrees(pose.rotation().between(turned.rotation()).axisAngle()[1]) == pytest.approx(2)
    moved = faults.moved_camera(D435I, 0.005).body_T_cam
    assert np.linalg.norm(moved.translation() - pose.translation()) == pytest.approx(0.005)
    assert faults.scaled_noise(D435I, 10.0).imu_noise.gyroscope == pytest.approx(
        10.0 * D435I.imu_noise.gyroscope
    )
    other = faults.other_camera(D435I, turned_camera := faults.turned_camera(D435I, 2.0))
    assert other.body_T_cam is turned_camera.body_T_cam
    assert faults.scaled_focal_length(D435I, 1.03).camera.fx == D435I.camera.fx * 1.03


def test_faults_can_be_chained():
    both = faults.chain(faults.drop_frames(0.3), faults.silent_imu(1.0, 0.5))
    assert len(stamps(both(STREAM), Frame)) < len(FRAMES)
    assert len(stamps(both(STREAM), ImuSample)) == len(SAMPLES) - 50
