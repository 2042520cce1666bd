# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np

from ruledgraph.core.measurements import Frame
from ruledgraph.frontend.prefetch import PrefetchCache


def frames(count: int) -> list[Frame]:
    return [Frame(10 * i, np.full((2, 3), i, np.uint8)) for i in range(count)]


def test_a_value_is_taken_once_by_its_frame():
    cache, coming = PrefetchCache[str](5), frames(3)
    for frame, value in zip(coming, "abc", strict=True):
        cache.put(frame, value)
    assert [cache.take(frame) for frame in coming] == ["a", "b", "c"]
    assert cache.take(coming[2]) is None


def test_what_is_passed_over_is_thrown_away():
    thrown: list[str] = []
    cache, coming = PrefetchCache[str](3, thrown.append), frames(4)
    for frame, value in zip(coming[:3], "abc", strict=True):
        cache.put(frame, value)
    assert cache.full
    assert cache.take(coming[3]) is None
    assert thrown == ["a", "b", "c"]
    assert not cache.full


def test_another_image_of_the_same_stamp_has_no_value():
    thrown: list[str] = []
    cache = PrefetchCache[str](3, thrown.append)
    cache.put(Frame(5, np.zeros((2, 3), np.uint8)), "a")
    assert cache.take(Frame(5, np.zeros((2, 3), np.uint8))) is None
    assert thrown == ["a"]
