# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Sliding windows run over ideal tracks: of a motion, and of a rest."""

from dataclasses import replace

import gtsam
import numpy as np

from ideal_tracks import CALIBRATION, IdealTracks, frame_times, ideal_tracks, start_of
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval
from ruledgraph.core.config import Config
from simulated_window import SplineMotion


def run_window(
    made: IdealTracks, config: Config | None = None, still_until: float = 0.0
) -> tuple[Window, list[Interval]]:
    """States of three frames each; the window at the end and the intervals that left it."""
    window = Window(CALIBRATION, config or Config(), start_of(made, velocity_error=0.05))
    left, tracks = [], made.tracks
    stamps, times = made.stamps[1:], made.times[1:].tolist()
    for first in range(0, len(times), 3):
        part = slice(first, first + 3)
        still = times[part][-1] < still_until
        window.extend(frame_times(stamps[part], times[part]), made.imu, tracks, still)
        left += window.optimize()
        rejected = window.line_manager.take_rejected()
        tracks = [track for track in tracks if track.id not in rejected]
    return window, left


def rested(steps: int, look_every: int = 0) -> Window:
    """States of nine frames at rest, optimised at every one without lines, or with them seldom."""
    times = np.linspace(0.0, 5.0, 11)
    motion = SplineMotion(times, np.zeros((11, 3)), np.tile([0.1, -0.2, 0.3], (11, 1)))
    made = ideal_tracks(0, motion, duration=4.5)
    at_rest = gtsam.NavState(motion.pose(0.0), np.zeros(3))
    window = Window(
        CALIBRATION, Config(), replace(start_of(made, velocity_error=0.05), state=at_rest)
    )
    for i in range(1, 9 * steps, 9):
        times = made.times[i : i + 9].tolist()
        looks = look_every > 0 and i // 9 % look_every == 0
        tracks = made.tracks if looks else []
        window.extend(frame_times(made.stamps[i : i + 9], times), made.imu, tracks, still=True)
        if looks or look_every == 0:
            window.optimize()
    return window
