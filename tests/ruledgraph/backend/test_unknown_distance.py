# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A body that rests for longer than a window, before lines at distances that nothing shows."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ideal_tracks import (
    CALIBRATION,
    MANY,
    IdealTracks,
    error_of,
    frame_times,
    ideal_tracks,
    start_of,
)
from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother, SmootherError
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.settings import load_config
from simulated_window import SplineMotion

CONFIG = load_config(None, ["window.lag=2"])
RESTS_UNTIL, DURATION = 5.4, 6.8
# A state is added every six frames.
STEP = 6
AT_REST = np.diag(np.square([0.02, 0.02, *np.full(4, 1e-4), *np.repeat([0.002, 0.3, 0.01], 3)]))


def rested_then_moved(seed: int, scale: float) -> IdealTracks:
    """Sideways by 0.1 m within a second, before lines `scale` times two metres away."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, DURATION + 0.3, 0.1)
    direction = np.append(0.0, rng.normal(size=2))
    share = np.clip(times - RESTS_UNTIL, 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    places = 0.1 * share[:, None] * direction / np.linalg.norm(direction)
    turns = np.tile([0.1, -0.2, 0.3], (len(times), 1))
    motion = SplineMotion(times, places, turns)
    return ideal_tracks(seed, motion, duration=DURATION, segments=scale * MANY)


def followed(made: IdealTracks) -> Iterator[Window]:
    """The window after each state, which is within three of its deviations of the truth."""
    window = Window(CALIBRATION, CONFIG, replace(start_of(made), covariance=AT_REST))
    for first in range(1, len(made.times) - STEP, STEP):
        part = slice(first, first + STEP)
        times = made.times[part].tolist()
        still = times[-1] < RESTS_UNTIL
        window.extend(frame_times(made.stamps[part], times), made.imu, made.tracks, still)
        window.optimize()
        node = window.newest
        sigma = np.sqrt(np.trace(node.covariance[3:6, 3:6]))
        assert error_of(node.state.pose(), made.motion.pose(node.time)) < 3.0 * sigma
        yield window
    assert window.newest.time > RESTS_UNTIL + 1.0


@pytest.mark.parametrize("scale", [0.25, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_what_lines_saw_at_rest_does_not_contradict_what_they_see_when_it_moves(seed, scale):
    """Half a metre away, where 3 m are expected, and as far as that."""
    *_, window = followed(rested_then_moved(seed, scale))
    # All lines fitted their points all the time.
    assert len(window.lines) == len(MANY)
    assert window.recoveries == []


def test_a_state_whose_second_solution_fails_is_recovered(monkeypatch):
    update, calls, failures = FixedLagSmoother.update, [], []

    def failing(self, *arguments):
        calls.append(self)
        if len(calls) == 2 and not failures:
            failures.append(self)
            raise SmootherError("the second solution fails")
        return update(self, *arguments)

    monkeypatch.setattr(FixedLagSmoother, "update", failing)
    for window in followed(rested_then_moved(0, 0.25)):
        calls.clear()
        recoveries = window.recoveries
    assert failures
    assert [reason.split(": ")[1] for reason in recoveries] == ["the second solution fails"]
