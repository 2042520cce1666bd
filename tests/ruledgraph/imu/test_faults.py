# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.imu.faults import SaturationDetector, SpikeFilter

RATE = 200.0
# Of a sample at 200 Hz of a D435i-like IMU, rad/s and m/s^2.
NOISE = np.repeat([0.0035, 0.021], 3)
# As fine as EuRoC's.
STEP = np.repeat([0.0007, 0.008], 3)


def hand_held(seed: int = 0, seconds: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and readings (N, 6): swinging by up to 0.6 rad/s and 2 m/s^2, gravity along y."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, 1.0 / RATE)
    swing = np.sin(
        2 * np.pi * (rng.uniform(0.4, 1.2, 6) * times[:, None] + rng.uniform(0.0, 1.0, 6))
    )
    values = swing * np.repeat([0.6, 2.0], 3) + np.array([0, 0, 0, 0, -9.81, 0])
    return times, values + rng.normal(size=values.shape) * NOISE


def quantised(values: np.ndarray, step: np.ndarray = STEP) -> np.ndarray:
    return np.round(values / step) * step


def filtered(times: np.ndarray, values: np.ndarray):
    spikes = SpikeFilter()
    taken = zip(times.tolist(), values, strict=True)
    return [reading for time, value in taken for reading in spikes.take(time, value)]


# -- spikes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_spikes_are_replaced_and_the_rest_is_left(seed):
    times, values = hand_held(seed)
    spiked = values.copy()
    at = np.arange(30, 990, 40)
    rng = np.random.default_rng([seed, 1])
    # Of a glitch some axes may be small: the whole reading goes.
    spiked[at] += rng.normal(size=(len(at), 6)) * np.repeat([3.0, 30.0], 3)
    readings = filtered(times, spiked)
    np.testing.assert_array_equal([r.time for r in readings], times)
    replaced = np.array([r.replaced for r in readings])
    np.testing.assert_array_equal(np.flatnonzero(replaced), at)
    out = np.array([r.value for r in readings])
    np.testing.assert_array_equal(out[~replaced], values[~replaced])
    # A line between two noisy samples, against another noisy sample: six deviations.
    assert np.all(np.abs(out - values) < 6 * np.sqrt(1.5) * NOISE)


def test_clean_readings_pass_at_once():
    times, values = hand_held()
    spikes = SpikeFilter()
    for time, value in zip(times.tolist(), values, strict=True):
        (reading,) = spikes.take(time, value)
        assert reading.value is value


def test_a_shock_is_no_spike():
    """A blow of 80 m/s^2 that the sensor's low-pass filter spreads over three samples."""
    times, values = hand_held()
    for first in (200, 400, 600):
        values[first : first + 3, 3] += [35.0, 80.0, 35.0]
    assert not any(reading.replaced for reading in filtered(times, values))


def test_shaking_at_half_the_rate_is_no_spike():
    """Propellers: every reading is far from both its neighbours, and swells within 0.1 s."""
    times, values = hand_held()
    swell = np.clip((times - 1.0) / 0.1, 0.0, 1.0)
    values[:, 3] += 5.0 * swell * np.cos(np.pi * RATE * times)
    assert not any(reading.replaced for reading in filtered(times, values))


def test_a_step_is_no_spike():
    times, values = hand_held()
    values[500:] += 5.0
    readings = filtered(times, values)
    assert len(readings) == len(times)
    assert not any(reading.replaced for reading in readings)


def test_nothing_is_replaced_across_a_hole():
    times, values = hand_held()
    values[500] += 30.0
    times[501:] += 0.1
    readings = filtered(times, values)
    assert [r.time for r in readings] == times.tolist()
    assert not any(reading.replaced for reading in readings)


def test_late_readings_are_left_out():
    times, values = hand_held()
    spikes = SpikeFilter()
    for i in range(100):
        spikes.take(float(times[i]), values[i])
    assert spikes.take(float(times[99]), values[100]) == []
    assert spikes.take(float(times[100]), values[100] + 50.0) == []  # held
    assert spikes.take(float(times[100]), values[101]) == []
    assert [r.replaced for r in spikes.take(float(times[101]), values[101])] == [True, False]


# -- range -----------------------------------------------------------------------------------------


def watched(times: np.ndarray, values: np.ndarray):
    watch = SaturationDetector()
    taken = zip(times.tolist(), values, strict=True)
    return watch, [news for time, value in taken if (news := watch.add(time, value))]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step", [STEP, 0.0])
def test_the_end_of_a_range_is_found(seed, step):
    times, values = hand_held(seed)
    if np.any(step):
        values = quantised(values, step)
    values *= np.clip(times / 0.5, 0.0, 1.0)[:, None]  # it begins within its range
    values[:, :3] = np.clip(values[:, :3], -0.35, 0.35)
    watch, news = watched(times, values)
    assert "ends at 0.35 rad/s" in "".join(news)
    assert all("gyroscope" in text for text in news)
    degraded = np.zeros(len(times), dtype=bool)
    for interval in watch.unreliable:
        degraded |= (times >= interval.start) & (times <= interval.stop)
        np.testing.assert_array_equal(interval.sigmas[3:], 0.0)
        assert set(interval.sigmas[:3].round(3)) <= {0.0, 0.175}  # half of the end
    at_end = np.any(np.abs(values[:, :3]) == 0.35, axis=1)
    assert np.mean(degraded[at_end]) > 0.95
    # Stretches begin at the reading before, and bridge some between noisy ones at the end.
    assert np.sum(degraded & ~at_end) < 0.3 * np.sum(at_end)


def test_a_sensor_within_its_range_has_no_end():
    for seed in range(20):
        times, values = hand_held(seed)
        assert watched(times, quantised(values))[1] == []


def test_a_coarse_sensor_at_rest_has_no_end():
    """Steps of three deviations: mostly the same reading again."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        times = np.arange(0.0, 5.0, 1.0 / RATE)
        still = np.array([0, 0, 0, 0, -9.81, 0]) + rng.normal(size=(len(times), 6)) * NOISE
        assert watched(times, quantised(still, 3.0 * NOISE))[1] == []


def test_a_slow_turn_back_has_no_end():
    """Without noise the reading stays at the top's step for long."""
    times = np.arange(0.0, 5.0, 1.0 / RATE)
    phases = 2 * np.pi * np.array([0.2, 0.31, 0.5, 0.23, 0.4, 0.7]) * times[:, None]
    values = np.sin(phases) * np.repeat([0.5, 3.0], 3)
    assert watched(times, quantised(values))[1] == []


def interpolated(times: np.ndarray, values: np.ndarray, each: int):
    """With a reading on the line between two after each so many, rounded to six digits."""
    rng = np.random.default_rng(0)
    after = np.arange(each, len(times) - 1, each)
    share = rng.uniform(size=len(after))
    between = times[after] + share * (times[after + 1] - times[after])
    line = values[after] + share[:, None] * (values[after + 1] - values[after])
    all_times = np.insert(times, after + 1, between)
    return all_times, np.insert(values, after + 1, line.round(6), axis=0)


def test_a_coarse_sensor_interpolated_in_between_has_no_end():
    """Turned slowly it stays at the top's step of 0.1 deg/s; between two it changes by less."""
    for seed in range(20):
        times, values = hand_held(seed)
        values[:, :3] *= 0.3
        coarse = quantised(values, np.repeat([0.001745, 0.008], 3))
        assert watched(*interpolated(times, coarse, each=8))[1] == []


def test_no_axis_ends_where_another_one_went_beyond():
    times, values = hand_held()
    values[:, 0] = np.clip(values[:, 0], -0.1, 0.1)
    assert watched(times, values)[1] == []


def test_readings_handed_out_again_have_no_end():
    """An accelerometer of 50 Hz whose last reading comes with each of the gyroscope's."""
    times, values = hand_held()
    values[:, 3:] = np.repeat(values[::4, 3:], 4, axis=0)
    assert watched(times, values)[1] == []


def test_what_goes_beyond_was_no_end():
    times, values = hand_held(seconds=2.0)
    values[:, :3] = np.clip(values[:, :3], -0.3, 0.3)
    watch, news = watched(times, values)
    assert news
    after = watch.unreliable[-1].stop
    later, beyond = hand_held(seed=1)
    for time, value in zip((later + 2.0).tolist(), beyond, strict=True):
        assert watch.add(time, value) == ""
    assert watch.unreliable[-1].stop == after


def test_where_another_axis_went_beyond_was_no_end():
    times, values = hand_held(seconds=2.0)
    values[:, :3] = np.clip(values[:, :3], -0.3, 0.3)
    watch, _ = watched(times, values)
    before = list(watch.unreliable)
    later, beyond = hand_held(seed=1)
    beyond[:, 0] = np.clip(beyond[:, 0], -0.3, 0.3)
    beyond[0, 1] = 0.6
    for time, value in zip((later + 2.0).tolist(), beyond, strict=True):
        watch.add(time, value)
    assert watch.unreliable == before


def test_unreliable_are_forgotten():
    times, values = hand_held()
    values[:, :3] = np.clip(values[:, :3], -0.3, 0.3)
    watch, _ = watched(times, values)
    half = watch.unreliable[len(watch.unreliable) // 2]
    watch.forget(half.stop)
    assert watch.unreliable[0] == half
    watch.forget(np.inf)
    assert watch.unreliable == []
