# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Two half IMUs made one, and 32-bit clocks."""

import numpy as np

from ruledgraph.core.measurements import MAX_IMU_GAP
from ruledgraph.live.split_imu import Clock, SplitImu

MS = 1_000_000


def test_the_force_is_that_at_the_gyroscopes_stamp():
    samples = []
    imu = SplitImu(lambda *sample: samples.append(sample))
    imu.add_gyroscope(np.ones(3), 5 * MS)  # before any force: left out
    imu.add_accelerometer(np.zeros(3), 10 * MS)
    imu.add_gyroscope(np.full(3, 2.0), 12 * MS)
    imu.add_gyroscope(np.full(3, 3.0), 16 * MS)
    assert not samples
    imu.add_accelerometer(np.array([0.0, 4.0, 8.0]), 14 * MS)
    ((angular_velocity, force, stamp),) = samples
    np.testing.assert_array_equal(angular_velocity, np.full(3, 2.0))
    np.testing.assert_allclose(force, [0.0, 2.0, 4.0])
    assert stamp == 12 * MS
    imu.add_accelerometer(np.zeros(3), 18 * MS)
    assert [stamp for *_, stamp in samples] == [12 * MS, 16 * MS]


def test_nothing_is_interpolated_across_a_gap():
    samples = []
    imu = SplitImu(lambda *sample: samples.append(sample))
    imu.add_accelerometer(np.zeros(3), 0)
    imu.add_gyroscope(np.zeros(3), 1 * MS)
    imu.add_accelerometer(np.zeros(3), MAX_IMU_GAP + 1)
    assert not samples


def test_readings_do_not_pile_up_while_the_other_sensor_is_silent():
    imu = SplitImu(lambda *_: None)
    for i in range(10_000):
        imu.add_gyroscope(np.zeros(3), i * MS)
    assert len(imu._waiting) <= MAX_IMU_GAP // MS + 2


def test_a_clock_goes_on_when_its_counter_begins_anew():
    turn = 2**32 * 1000
    clock = Clock()
    assert clock.unwrapped(turn - 2 * MS) == turn - 2 * MS
    assert clock.unwrapped(1 * MS) == turn + 1 * MS
    assert clock.unwrapped(turn - 1 * MS) == turn - 1 * MS  # another stream's, a little late
    assert clock.unwrapped(3 * MS) == turn + 3 * MS
    for step in range(1, 9):
        assert clock.unwrapped(step * turn // 4 % turn) == turn + step * turn // 4
