# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ruledgraph.core.messages import Messages
from ruledgraph.core.timing import Timing


def test_a_million_durations_are_few_numbers():
    rng = np.random.default_rng(0)
    durations = np.exp(rng.normal(-6.0, 1.0, 20_000))
    timing = Timing()
    for seconds in durations.tolist():
        timing.add(seconds)
    assert timing.count == 20_000
    assert timing.mean == pytest.approx(durations.mean())
    assert timing.largest == durations.max()
    assert timing.last == durations[-1]
    for share in (0.1, 0.5, 0.99):
        assert timing.quantile(share) == pytest.approx(np.quantile(durations, share), rel=0.03)
    assert timing.quantile(1.0) == pytest.approx(durations.max(), rel=0.01)
    assert len(timing._bins) < 700


def test_an_empty_stage_and_a_clock_that_stands():
    timing = Timing()
    assert (timing.mean, timing.quantile(0.99)) == (0.0, 0.0)
    timing.add(0.0)
    assert timing.quantile(0.99) == 0.0


def test_messages_are_counted_when_there_are_too_many():
    messages = Messages()
    for i in range(1000):
        messages.append("no start, " + "again " * i)
    assert messages[0] == "no start, "
    assert len(messages) + messages.left_off == 1000
    assert len(messages) < 300


def test_messages_that_differ_in_figures_alone_become_one():
    messages = Messages()
    for i in range(1000):
        messages.append(f"no start at {0.25 * i:.2f} s: {i} lines, {1e-3 * i:.2g} m/s")
    messages.append("no start at 3.00 s: too little motion")
    assert messages == [
        "no start at 0.00 s: 0 lines, 0 m/s (1000 times)",
        "no start at 3.00 s: too little motion",
    ]
    assert messages.left_off == 0


def test_some_are_said_once():
    messages = Messages()
    for i in range(3):
        messages.once("late", f"a frame came late at {i} s")
    assert messages == ["a frame came late at 0 s"]


def test_how_often_is_told_with_the_first():
    messages = Messages()
    messages.append("another")
    for i in range(3):
        messages.counted("spikes", f"a spike at {i} s")
    messages.append("a third")
    assert messages == ["another", "a spike at 0 s (3 times)", "a third"]
