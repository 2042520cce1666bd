# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A body that moves, and then rests for longer than a window: its images show the same again."""

import gtsam
import numpy as np

from ideal_tracks import CALIBRATION, IdealTracks, error_of, frame_times, ideal_tracks, start_of
from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.settings import load_config
from simulated_window import SplineMotion

LAG = 2.5
CONFIG = load_config(None, [f"window.lag={LAG}"])
RESTS_FROM, DURATION = 2.0, 8.0
# A state is added every six frames.
STEP = 6


def moved_then_rested(seed: int) -> IdealTracks:
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, DURATION + 0.5, 0.2)
    places = np.zeros((len(times), 3))
    places[:9] = rng.normal(scale=0.15, size=(9, 3))
    places[9:] = places[8]
    turns = np.tile([0.1, -0.2, 0.3], (len(times), 1))
    return ideal_tracks(seed, SplineMotion(times, places, turns), duration=DURATION)


def extend(window: Window, made: IdealTracks, first: int, lines: int) -> None:
    """By a state, at which so many of the lines are seen."""
    part = slice(first, first + STEP)
    times = made.times[part].tolist()
    still = times[0] > RESTS_FROM + 0.2
    window.extend(frame_times(made.stamps[part], times), made.imu, made.tracks[:lines], still)
    window.optimize()


def test_images_at_rest_are_no_news_of_lines_that_were_seen(monkeypatch):
    """Nor of where the body is: their errors are those of the images before."""
    added: list[int] = []
    update = FixedLagSmoother.update

    def counting(self, factors, *others):
        keys = (factors.at(i).keys() for i in range(factors.size()))
        added.append(sum(any(gtsam.Symbol(k).chr() == ord("l") for k in own) for own in keys))
        return update(self, factors, *others)

    monkeypatch.setattr(FixedLagSmoother, "update", counting)
    made = moved_then_rested(0)
    window = Window(CALIBRATION, CONFIG, start_of(made))
    for first in range(1, len(made.times) - STEP, STEP):
        added.clear()
        extend(window, made, first, lines=12)
        # The whole window has rested from then on.
        if window.nodes[0].time > RESTS_FROM + 0.5:
            assert not any(added)
            # They are compared all the same, so that lines that move are found.
            assert window.intervals[-1].compared == 12
        elif 0.5 < window.newest.time < RESTS_FROM + LAG:
            assert max(added) >= 12
        if window.newest.time > RESTS_FROM + 0.5:
            assert error_of(window.newest.state.pose(), made.motion.pose(DURATION)) < 0.005
    assert len(window.lines) == 12


def test_new_lines_wait_until_the_body_moves():
    made = moved_then_rested(1)
    window = Window(CALIBRATION, CONFIG, start_of(made))
    for first in range(1, len(made.times) - STEP, STEP):
        seen = 8 if made.times[first] < 6.0 else 12
        extend(window, made, first, seen)
    assert len(window.lines) == 8
