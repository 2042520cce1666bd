# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the looks at the images make of a readout that the calibration says nothing of."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ruledgraph.calibration.camera_mounting import CameraMounting
from ruledgraph.core.config import DEFAULTS
from ruledgraph.core.timing import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization import readout_search
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.readout import ReadoutEstimate
from ruledgraph.initialization.readout_search import ReadoutSearch
from ruledgraph.simulation.simulation import D435I

CERTAIN, UNCERTAIN = 100.0, 1.0


class Looks:
    """In place of images: each look finds the next of these estimates."""

    most = 40

    def __init__(self, found: Sequence[ReadoutEstimate | None]) -> None:
        self.left = list(found)
        self.as_global: list[bool] = []
        times = 0.2 + 0.05 * np.arange(41)
        self.pairs = PointPairs(np.column_stack([times[:-1], times[1:]]), *np.ones((2, 40, 5, 3)))
        self.count = 40

    def add_image(self, time: float, image: np.ndarray) -> None:
        pass

    def look(self, *given: object) -> ReadoutEstimate | None:
        self.as_global.append(given[2].readout == 0.0)
        return self.left.pop(0)


def searched(
    monkeypatch: pytest.MonkeyPatch, found: Sequence[ReadoutEstimate | None], turning: float = 1.0
) -> tuple[list[float], ReadoutSearch, Messages, Looks]:
    """The readout in use after each of three searches."""
    looks, warnings = Looks(found), Messages()
    calibration = replace(D435I, line_delay=None)
    mounting = CameraMounting(calibration, DEFAULTS.extrinsics, warnings)
    monkeypatch.setattr(readout_search, "ClockOffsetFinder", lambda *_: looks)
    monkeypatch.setattr(readout_search, "estimated_readout", looks.look)
    search = ReadoutSearch(mounting, 0.1, warnings)
    imu = ImuBuffer()
    for time in np.arange(0.0, 3.0, 0.005).tolist():
        imu.append(time, turning * np.sin([9 * time, 7 * time, 5 * time]), np.zeros(3))
    used = []
    for _ in range(3):
        search.search(imu)
        used.append(mounting.calibration.readout)
    return used, search, warnings, looks


def test_the_first_look_is_used_and_then_the_mean(monkeypatch):
    found = [ReadoutEstimate(0.020, 0.005, CERTAIN), ReadoutEstimate(0.030, 0.005, CERTAIN)]
    used, search, warnings, looks = searched(monkeypatch, found)
    assert used == pytest.approx([0.020, 0.025, 0.025])
    assert search.found == pytest.approx((0.025, 0.005 / np.sqrt(2)))
    assert [w for w in map(str, warnings) if "rows are read within 20 ms" in w] == list(
        map(str, warnings)
    )
    assert looks.as_global == [True, True]
    assert search._mounting.calibration.middle_row_delay == 0.0


def test_means_are_weighted_by_their_variances(monkeypatch):
    found = [ReadoutEstimate(0.020, 0.003, CERTAIN), ReadoutEstimate(0.030, 0.006, CERTAIN)]
    used, search, _, _ = searched(monkeypatch, found)
    assert used[-1] == pytest.approx((4 * 0.020 + 0.030) / 5)
    assert search.found.sigma == pytest.approx((0.003**-2 + 0.006**-2) ** -0.5)


def test_two_looks_find_what_one_alone_does_not(monkeypatch):
    found = [ReadoutEstimate(0.014, 0.005, CERTAIN), ReadoutEstimate(0.014, 0.005, CERTAIN)]
    used, _, _, _ = searched(monkeypatch, found)
    assert used == pytest.approx([0.0, 0.014, 0.014])


@pytest.mark.parametrize(
    "second", [None, ReadoutEstimate(0.02, 0.005, UNCERTAIN), ReadoutEstimate(0.0, 0.005, CERTAIN)]
)
def test_a_second_look_that_shows_none_takes_it_back(monkeypatch, second):
    used, search, warnings, _ = searched(
        monkeypatch, [ReadoutEstimate(0.020, 0.005, CERTAIN), second]
    )
    assert used == pytest.approx([0.020, 0.0, 0.0])
    assert search.found is None
    assert "the shutter counts as global" in str(warnings[-1])


@pytest.mark.parametrize("first", [None, ReadoutEstimate(0.03, 0.005, UNCERTAIN)])
def test_after_a_first_look_that_shows_none_there_is_no_other(monkeypatch, first):
    used, search, warnings, looks = searched(monkeypatch, [first])
    assert used == [0.0, 0.0, 0.0]
    assert search.found is None
    assert len(looks.as_global) == 1
    assert not list(warnings)


def test_there_is_no_look_without_turning(monkeypatch):
    used, _, _, looks = searched(monkeypatch, [], turning=0.01)
    assert used == [0.0, 0.0, 0.0]
    assert looks.as_global == []
