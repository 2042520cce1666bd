# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Which of two time offsets stands: the one that images turn by, or the one known before."""

import numpy as np
import pytest

from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.core.messages import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization.calibration_search import CalibrationSearch
from ruledgraph.initialization.time_offset_finder import FoundTimeOffset, TimeOffsetFinder
from ruledgraph.simulation import D435I
from ruledgraph.synchronization.camera_clock import CameraClock
from ruledgraph.synchronization.synchronizer import Synchronizer

FOUND = FoundTimeOffset(0.044, 0.008, np.zeros(3), np.zeros(3))


def search_and_clock(warnings: Messages) -> tuple[CalibrationSearch, CameraClock]:
    config, sensors = Config(), Synchronizer(D435I, warnings)
    clock = CameraClock(sensors, D435I.time_offset, config.time_offset, warnings)
    online_calibration = OnlineCalibration(D435I, config, warnings)
    return CalibrationSearch(online_calibration, clock, config, warnings), clock


@pytest.mark.parametrize(
    ("known", "by_window", "used"),
    [
        (TimeOffset(0.0, 0.0), False, True),  # the calibration's, before a start
        (TimeOffset(0.0, 0.002), True, False),  # the window knows it better
        (TimeOffset(0.0, 0.009), True, True),  # it does not yet
        (TimeOffset(0.0, 0.002), False, True),  # it does, but lines or IMU contradict it
        (TimeOffset(0.03, 0.009), True, False),  # 1.2 standard deviations apart
    ],
)
def test_what_the_images_say_is_used(known, by_window, used, monkeypatch):
    monkeypatch.setattr(TimeOffsetFinder, "find", lambda _self, _samples: FOUND)
    imu, warnings = ImuBuffer(), Messages()
    for time in (0.0, 0.005):
        imu.append(time, np.full(3, time), np.array([0.0, 0.0, 9.81]))
    search, clock = search_and_clock(warnings)
    result = search.search(imu, known, by_window)
    assert (result is not None) == used == search.used == bool(warnings)
    assert search.found is FOUND
    prior = clock.start_prior
    assert prior is not None
    # What stands is known as well as the other one is far from it.
    left_over = FOUND.sigma if used else np.hypot(FOUND.sigma, FOUND.value - known.value)
    kept = known.sigma < FOUND.sigma and by_window
    widest = Config().time_offset.sigma
    assert prior.sigma == (widest if kept else pytest.approx(min(left_over, widest)))
    # It is looked for once a segment.
    assert search.search(imu, TimeOffset(0.0, 0.0), False) is None


def test_images_that_are_processed_anew_tell_nothing_new(monkeypatch):
    """Neither do they to a search that has begun again since."""
    added: list[float] = []
    monkeypatch.setattr(TimeOffsetFinder, "add_image", lambda _self, time, _: added.append(time))
    search, _ = search_and_clock(Messages())
    image = np.zeros((2, 2), np.uint8)
    for time in (0.0, 0.1):
        search.add_image(time, image)
    search.restart()
    for time in (0.0, 0.1, 0.2):
        search.add_image(time, image)
    assert added == [0.0, 0.1, 0.2]


def test_an_offset_far_from_what_is_known_is_doubted_while_images_may_show_it(monkeypatch):
    imu = ImuBuffer()
    for time in (0.0, 0.005):
        imu.append(time, np.full(3, time), np.array([0.0, 0.0, 9.81]))
    search, clock = search_and_clock(Messages())
    three_sigma = 3.0 * Config().time_offset.sigma
    known = D435I.time_offset
    assert not search.contradicts_known(known + 0.99 * three_sigma)
    assert search.contradicts_known(known - 1.01 * three_sigma)
    clock.offset = TimeOffset(0.02, 0.0)
    assert not search.contradicts_known(0.02 + 0.99 * three_sigma)
    assert search.contradicts_known(0.02 + 1.01 * three_sigma)
    # Until images of as long as a first window have not shown it, or they have.
    image = np.zeros((2, 2), np.uint8)
    for time, doubted in ((1.0, True), (3.4, True), (3.6, False)):
        search.add_image(time, image)
        assert search.contradicts_known(0.1) == doubted
    search.restart()
    search.add_image(3.7, image)
    assert search.contradicts_known(0.1)
    monkeypatch.setattr(TimeOffsetFinder, "find", lambda _self, _samples: FOUND)
    search.search(imu, clock.offset, False)
    assert not search.contradicts_known(0.1)
