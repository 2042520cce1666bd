# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.imu.buffer import ImuBuffer, params_across
from ruledgraph_factors import STANDARD_GRAVITY

STEP = 0.005
GRAVITY = np.array(STANDARD_GRAVITY)


def filled(skip=(), frozen=()) -> ImuBuffer:
    """Samples at 200 Hz for a second, without those in `skip`, and with repetitions in `frozen`."""
    rng = np.random.default_rng(0)
    imu, reading = ImuBuffer(), rng.normal(size=(2, 3))
    for i in range(200):
        if i in skip:
            continue
        if i not in frozen:
            reading = rng.normal(size=(2, 3))
        imu.append(i * STEP, *reading)
    return imu


def test_where_samples_are_missing_there_is_a_hole():
    imu = filled(skip=range(100, 140))
    ((start, stop, _),) = imu.unreliable(0.0, 0.99)
    assert (start, stop) == pytest.approx((99 * STEP, 140 * STEP))
    assert len(imu.unreliable(0.6, 0.65)) == 1
    assert imu.unreliable(0.0, 0.495) == imu.unreliable(0.701, 0.9) == []
    assert filled(skip=range(100, 105)).unreliable(0.0, 0.99) == []


def test_a_frozen_imu_is_silent():
    imu = filled(frozen=range(100, 140))
    ((start, stop, _),) = imu.unreliable(0.0, 0.99)
    assert (start, stop) == pytest.approx((99 * STEP, 140 * STEP))


def test_while_it_is_frozen_time_stands_still_and_then_it_is_reported():
    imu = filled(frozen=range(150, 200))
    assert imu.latest == pytest.approx(149 * STEP)
    assert imu.append(200 * STEP, np.ones(3), np.ones(3)) == pytest.approx(50 * STEP)
    assert imu.latest == pytest.approx(200 * STEP)


def test_some_equal_readings_are_samples():
    imu = filled(frozen=(100, 101, 102))
    assert len(imu.between(0.0, 0.995).times) == 200


def test_noise_across_holes():
    clean = params_across(D435I_LIKE, GRAVITY, [], 0.0, 0.1)
    assert clean.equals(D435I_LIKE.preintegration_params(), 0.0)
    densities = []
    for length in (0.06, 0.1, 0.3, 0.5):
        imu = filled(skip=range(40, 40 + round(length / STEP)))
        (dropout,) = imu.unreliable(0.0, 0.99)
        density = rate_density(dropout, dropout.start, dropout.stop)
        densities.append(density)
        # Half of it has what belongs to half of it.
        middle = 0.5 * (dropout.start + dropout.stop)
        assert rate_density(dropout, dropout.start, middle) == pytest.approx(density)
        assert rate_density(dropout, dropout.start - 0.1, dropout.stop) < density
    assert densities == sorted(densities)
    # After half a second of silence the attitude is open by half of that, in rad, at 0.5 rad/s.
    assert densities[-1] * np.sqrt(0.5) == pytest.approx(0.25, rel=0.05)


def rate_density(interval, start: float, stop: float) -> float:
    """Of the gyroscope, rad/s/sqrt(Hz), the same in all directions."""
    params = params_across(D435I_LIKE, GRAVITY, [interval], start, stop)
    covariance = params.getGyroscopeCovariance()
    np.testing.assert_allclose(covariance, covariance[0, 0] * np.eye(3), atol=1e-15)
    return float(np.sqrt(covariance[0, 0]))


def clipped() -> ImuBuffer:
    """Swinging about x at 1 Hz by 1 rad/s for 2 s at 200 Hz; the gyroscope ends at 0.8 rad/s."""
    rng = np.random.default_rng(0)
    imu = ImuBuffer()
    for time in np.arange(0.0, 2.0, STEP).tolist():
        rate = np.array([np.sin(2 * np.pi * time), 0.0, 0.0]) + 0.003 * rng.normal(size=3)
        force = np.array([0.0, 0.0, 9.81]) + 0.02 * rng.normal(size=3)
        imu.append(time, np.clip(rate, -0.8, 0.8), force)
    return imu


def test_clipped_readings_are_degraded_in_their_axis():
    imu = clipped()
    upper, lower, *_ = unreliable = imu.unreliable(0.0, 2.0)
    assert len(unreliable) == 4
    # A sine is above 0.8 from 53 to 127 degrees.
    assert (upper.start, upper.stop) == pytest.approx((53 / 360, 127 / 360), abs=2 * STEP)
    assert (lower.start, lower.stop) == pytest.approx((233 / 360, 307 / 360), abs=2 * STEP)
    covariance = params_across(
        D435I_LIKE, GRAVITY, [upper], upper.start, upper.stop
    ).getGyroscopeCovariance()
    # Open by half of 0.8 rad/s all along.
    length = upper.stop - upper.start
    assert np.sqrt(covariance[0, 0] * length) == pytest.approx(0.4 * length, rel=0.01)
    assert covariance[1, 1] == covariance[2, 2] == pytest.approx(D435I_LIKE.gyroscope**2)
    imu.forget(1.0)
    assert len(imu.unreliable(0.0, 2.0)) == 2


def test_clipped_readings_after_a_gap_do_not_reach_back_to_before_it():
    imu = clipped()
    imu.clear()
    assert not imu.unreliable(0.0, 2.0)
    for time in (30.0 + np.arange(10) * STEP).tolist():
        imu.append(time, np.array([0.8, 0.0, 1e-3 * time]), np.array([0.0, 0.0, 9.81]))
    (interval,) = imu.unreliable(0.0, 31.0)
    # Where the range ends is known from before.
    assert interval.start == pytest.approx(30.0)


def test_how_long_estimates_are_unsure():
    imu = clipped()
    assert imu.was_degraded(0.2)
    assert not imu.was_degraded(0.1)
    assert not imu.in_long_dropout(0.2)  # lines are still where the other axes say
    for missing, unsure in ((15, False), (60, True)):
        imu = filled(skip=range(40, 40 + missing))
        assert imu.in_long_dropout((40 + missing - 2) * STEP) == unsure
        assert not imu.in_long_dropout((40 + missing + 1) * STEP)
        assert imu.was_degraded((40 + missing + 10) * STEP) == unsure


def test_where_all_axes_are_clipped_one_after_the_other_there_is_no_hole():
    """However short it is, what was felt is not known."""
    imu, phases = ImuBuffer(), np.array([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])
    for time in (np.arange(200) * STEP).tolist():
        reading = np.clip(np.sin(2.0 * np.pi * time - phases), -0.8, 0.8)
        imu.append(time, reading[:3], reading[3:])
    assert any(np.all(interval.sigmas > 0.0) for interval in imu.unreliable(0.0, 1.0))
    assert imu.interrupted(0.0, 1.0)
    assert not any(imu.in_long_dropout(time) for time in np.linspace(0.05, 0.95, 19).tolist())


def test_a_message_about_the_range_comes_once():
    imu = ImuBuffer()
    swing = 4.0 * np.sin(np.arange(400) * 0.05)
    messages = []
    for i, rate in enumerate(np.clip(swing, -2.0, 2.0)):
        imu.append(i * STEP, np.array([rate, 1e-4 * i, 0.0]), np.array([0.0, 0.0, 9.81]))
        messages.append(imu.range_message)
        # A sample that came twice says nothing new.
        imu.append(i * STEP, np.array([rate, 1e-4 * i, 0.0]), np.array([0.0, 0.0, 9.81]))
        messages.append(imu.range_message)
    said = [message for message in messages if message]
    assert said
    assert len(said) == len(set(said))
