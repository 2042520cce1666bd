# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
import threading

import numpy as np

from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.live.sensor_queue import SensorQueue, Signal

MS = 1_000_000
IMAGE = np.zeros((2, 2), np.uint8)


def sample(ms: int) -> ImuSample:
    return ImuSample(ms * MS, np.zeros(3), np.zeros(3))


def taken(queue: SensorQueue) -> list:
    """What is left until the end, ms of the IMU's samples, negative of frames."""
    queue.end()
    items = []
    while (item := queue.take()) is not Signal.END:
        sign = -1 if isinstance(item, Frame) else 1
        items.append(item if isinstance(item, Signal) else sign * item.stamp // MS)
    return items


def test_two_streams_leave_in_order_of_time():
    queue = SensorQueue(0, 8)
    for ms in (10, 40):
        queue.put_frame(Frame(ms * MS, IMAGE))
    for ms in range(0, 60, 15):
        queue.put_imu(sample(ms))
    assert taken(queue) == [0, -10, 15, 30, -40, 45]


def test_frames_are_ordered_on_the_imus_clock():
    queue = SensorQueue(20 * MS, 8)
    queue.put_frame(Frame(10 * MS, IMAGE))
    for ms in (0, 15, 30, 45):
        queue.put_imu(sample(ms))
    assert taken(queue) == [0, 15, -10, 30, 45]


def test_without_imu_samples_the_latest_frames_are_kept():
    queue = SensorQueue(0, 3)
    fits = [queue.put_frame(Frame(ms * MS, IMAGE)) for ms in range(100)]
    assert fits == [True] * 3 + [False] * 97
    assert (len(queue), queue.dropped_frames) == (3, 97)
    assert taken(queue) == [-97, -98, -99]


def test_without_frames_the_latest_imu_samples_are_kept():
    queue = SensorQueue(0, 3)
    fits = [queue.put_imu(sample(5 * i)) for i in range(4000)]
    assert fits.count(False) == queue.dropped_imu == 4000 - 1001  # 5 s of 20 s
    assert taken(queue)[0] == 14_995


def test_the_worker_waits_for_what_a_frame_needs():
    queue, items = SensorQueue(0, 3), []

    def work():
        while (item := queue.take()) is not Signal.END:
            items.append(item)

    worker = threading.Thread(target=work)
    worker.start()
    for ms in (0, 10, 20):
        queue.put_imu(sample(ms))
    queue.put_frame(Frame(25 * MS, IMAGE))
    queue.put_imu(sample(30))
    queue.end()
    worker.join(5.0)
    assert [item.stamp // MS for item in items] == [0, 10, 20, 25, 30]


def test_a_reset_comes_first_and_forgets_what_waits():
    queue = SensorQueue(0, 3)
    queue.put_imu(sample(1000))
    queue.put_frame(Frame(900 * MS, IMAGE))
    queue.reset()
    queue.put_imu(sample(1))
    assert taken(queue) == [Signal.RESET, 1]
    assert (queue.dropped_frames, queue.dropped_imu) == (0, 0)
