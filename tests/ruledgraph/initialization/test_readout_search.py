# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the looks at the images make of a readout that the calibration says nothing of."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.core.config import DEFAULTS
from ruledgraph.core.messages import Messages
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.initialization import readout_search
from ruledgraph.initialization.image_rotation import PointPairs
from ruledgraph.initialization.readout import ReadoutEstimate
from ruledgraph.initialization.readout_search import ReadoutSearch
from ruledgraph.simulation.simulation import D435I


def look(value: float, sigma: float = 0.005, certain: bool = True) -> ReadoutEstimate:
    """40 of 40 pairs are better explained, or 20."""
    return ReadoutEstimate(value, sigma, 100.0, 40 if certain else 20, 40)


class Looks:
    """In place of images: each look finds the next of these estimates."""

    max_pairs = 40

    def __init__(self, found: Sequence[ReadoutEstimate | None]) -> None:
        self.left = list(found)
        self.as_global: list[bool] = []
        times = 0.2 + 0.05 * np.arange(41)
        self.pairs = PointPairs(np.column_stack([times[:-1], times[1:]]), *np.ones((2, 40, 5, 3)))
        self.count = 0

    def add_image(self, time: float, image: np.ndarray) -> None:
        pass

    def look(self, *given: object) -> ReadoutEstimate | None:
        self.as_global.append(given[2].readout == 0.0)
        return self.left.pop(0)


def searched(
    monkeypatch: pytest.MonkeyPatch,
    found: Sequence[ReadoutEstimate | None],
    turning: float = 1.0,
    counts: Sequence[int] = (40, 40, 40),
) -> tuple[list[float], ReadoutSearch, Messages, Looks]:
    """The readout in use after a search with each of these counts of pairs."""
    looks, warnings = Looks(found), Messages()
    calibration = replace(D435I, line_delay=None)
    online_calibration = OnlineCalibration(calibration, DEFAULTS, warnings)
    monkeypatch.setattr(readout_search, "TimeOffsetFinder", lambda *_: looks)
    monkeypatch.setattr(readout_search, "estimated_readout", looks.look)
    search = ReadoutSearch(online_calibration, 0.1, warnings)
    imu = ImuBuffer()
    for time in np.arange(0.0, 3.0, 0.005).tolist():
        imu.append(time, turning * np.sin([9 * time, 7 * time, 5 * time]), np.zeros(3))
    used = []
    for looks.count in counts:
        search.search(imu)
        used.append(online_calibration.current.readout)
    return used, search, warnings, looks


def test_the_first_images_are_used_and_then_the_mean(monkeypatch):
    found = [look(0.020), look(0.030)]
    used, search, warnings, looks = searched(monkeypatch, found, counts=[40, 40])
    assert used == pytest.approx([0.020, 0.025])
    assert search.found == pytest.approx((0.025, 0.005 / np.sqrt(2)))
    assert [w for w in map(str, warnings) if "rolling shutter: readout 20 ± 5 ms" in w] == list(
        map(str, warnings)
    )
    assert looks.as_global == [True, True]
    assert search._online_calibration.current.middle_row_delay == 0.0


def test_looks_come_early_and_with_twice_as_many_pairs(monkeypatch):
    found = [None, look(0.020), look(0.022), look(0.024)]
    counts = [9, 10, 12, 19, 20, 39, 40, 10, 20, 39, 40]
    used, _, _, looks = searched(monkeypatch, found, counts=counts)
    assert used == pytest.approx([0.0] * 4 + [0.020] * 2 + [0.022] * 4 + [0.023])
    assert not looks.left


UNCERTAIN = look(0.02, certain=False)._replace(gain=20.0)


@pytest.mark.parametrize("later", [None, UNCERTAIN, look(0.01)])
def test_early_looks_stand_until_all_first_images_are_there(monkeypatch, later):
    found = [look(0.020), later, later]
    used, search, warnings, _ = searched(monkeypatch, found, counts=[10, 20, 40])
    assert used == pytest.approx([0.020, 0.020, 0.0])
    assert search.found is None
    assert "the shutter counts as global" in str(warnings[-1])


def test_a_few_pairs_alone_do_not_make_an_estimate_certain():
    """At 95 %."""
    shares = {(9, 10): True, (8, 10): False, (15, 20): True, (14, 20): False, (26, 40): True}
    for (improved, pairs), certain in shares.items():
        found = ReadoutEstimate(0.02, 0.005, 100.0, improved, pairs)
        assert found.is_certain == certain
        assert not found._replace(gain=20.0).is_certain


def test_means_are_weighted_by_their_variances(monkeypatch):
    found = [look(0.020, 0.003), look(0.030, 0.006)]
    used, search, _, _ = searched(monkeypatch, found, counts=[40, 40])
    assert used[-1] == pytest.approx((4 * 0.020 + 0.030) / 5)
    assert search.found.sigma == pytest.approx((0.003**-2 + 0.006**-2) ** -0.5)


def test_both_together_find_what_one_alone_does_not(monkeypatch):
    used, _, _, _ = searched(monkeypatch, [look(0.014), look(0.014)], counts=[40, 40])
    assert used == pytest.approx([0.0, 0.014])


def test_it_goes_on_until_the_readout_is_known_to_two_milliseconds(monkeypatch):
    found = [look(0.020), look(0.024), None, look(0.028, certain=False), *[look(0.024)] * 4]
    used, search, _, looks = searched(monkeypatch, found, counts=[40] * 9)
    assert used[:5] == pytest.approx([0.020, 0.022, 0.022, 0.024, 0.024])
    assert search.finder is None
    assert search.found == pytest.approx((0.024, 0.005 / np.sqrt(7)))
    assert not looks.left


@pytest.mark.parametrize("second", [look(0.0, 0.004, certain=False), look(0.0)])
def test_later_images_that_show_none_take_it_back(monkeypatch, second):
    used, search, warnings, _ = searched(monkeypatch, [look(0.020), second])
    assert used == pytest.approx([0.020, 0.0, 0.0])
    assert search.found is None
    assert "the shutter counts as global" in str(warnings[-1])


def test_first_images_of_which_a_few_show_one_are_followed_by_others(monkeypatch):
    found = [look(0.03, certain=False), look(0.024), look(0.026)]
    used, _, _, _ = searched(monkeypatch, found)
    assert used == pytest.approx([0.0, 0.024, 0.025])


def test_what_early_looks_found_stands_where_a_few_pairs_say_another(monkeypatch):
    found = [look(0.022), look(0.023), look(0.03, certain=False), look(0.024)]
    used, _, _, _ = searched(monkeypatch, found, counts=[10, 20, 40, 10])
    assert used == pytest.approx([0.022, 0.023, 0.023, 0.024])


@pytest.mark.parametrize("first", [None, UNCERTAIN])
def test_after_first_images_that_show_none_there_are_no_others(monkeypatch, first):
    used, search, warnings, looks = searched(monkeypatch, [first])
    assert used == [0.0, 0.0, 0.0]
    assert search.found is None
    assert len(looks.as_global) == 1
    assert not list(warnings)


def test_there_is_no_look_without_turning(monkeypatch):
    used, _, _, looks = searched(monkeypatch, [], turning=0.01)
    assert used == [0.0, 0.0, 0.0]
    assert looks.as_global == []
