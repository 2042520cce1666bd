# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.inertial import ImuBuffer, noise_across
from ruledgraph.sensors import D435I_LIKE

STEP = 0.005


def filled(skip=(), hang=()) -> ImuBuffer:
    """Samples at 200 Hz for a second, without those in `skip`, and with repetitions in `hang`."""
    rng = np.random.default_rng(0)
    imu, reading = ImuBuffer(), rng.normal(size=(2, 3))
    for i in range(200):
        if i in skip:
            continue
        if i not in hang:
            reading = rng.normal(size=(2, 3))
        imu.append(i * STEP, *reading)
    return imu


def test_where_samples_are_missing_there_is_a_hole():
    imu = filled(skip=range(100, 140))
    ((start, stop),) = imu.holes(0.0, 0.99)
    assert (start, stop) == pytest.approx((99 * STEP, 140 * STEP))
    assert len(imu.holes(0.6, 0.65)) == 1
    assert imu.holes(0.0, 0.495) == imu.holes(0.701, 0.9) == []
    assert filled(skip=range(100, 105)).holes(0.0, 0.99) == []


def test_a_hanging_imu_is_silent():
    imu = filled(hang=range(100, 140))
    ((start, stop),) = imu.holes(0.0, 0.99)
    assert (start, stop) == pytest.approx((99 * STEP, 140 * STEP))


def test_while_it_hangs_time_stands_still_and_then_it_is_told():
    imu = filled(hang=range(150, 200))
    assert imu.latest == pytest.approx(149 * STEP)
    assert imu.append(200 * STEP, np.ones(3), np.ones(3)) == pytest.approx(50 * STEP)
    assert imu.latest == pytest.approx(200 * STEP)


def test_some_equal_readings_are_samples():
    imu = filled(hang=(100, 101, 102))
    assert len(imu.between(0.0, 0.995).times) == 200


def test_noise_across_holes():
    assert noise_across(D435I_LIKE, [], 0.0, 0.1) == D435I_LIKE
    densities = []
    for length in (0.06, 0.1, 0.3, 0.5):
        imu = filled(skip=range(40, 40 + round(length / STEP)))
        (hole,) = imu.holes(0.0, 0.99)
        noise = noise_across(D435I_LIKE, [hole], *hole)
        densities.append(noise.gyroscope)
        assert noise.gyroscope_walk == D435I_LIKE.gyroscope_walk
        # Half of it has what belongs to half of it.
        part = noise_across(D435I_LIKE, [hole], hole.start, 0.5 * sum(hole))
        assert part.gyroscope == pytest.approx(noise.gyroscope)
        outside = noise_across(D435I_LIKE, [hole], hole.start - 0.1, hole.stop)
        assert outside.gyroscope < noise.gyroscope
    assert densities == sorted(densities)
    # After half a second of silence the attitude is open by half of that, in rad, at 0.5 rad/s.
    assert densities[-1] * np.sqrt(0.5) == pytest.approx(0.25, rel=0.05)
