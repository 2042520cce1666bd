# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines that err more than the others count for less."""

import numpy as np
import pytest

from ideal_tracks import IdealTracks, error_of, ideal_tracks, sighting
from ruledgraph.backend.line_weights import reweigh
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.settings import load_config
from simulated_window import FOCAL_LENGTH, hand_held
from window_runs import run_window

SETTINGS = ["edges.sigma_px=0.5", "lines.cauchy_scale_px=0"]


def wandering(seed: int, off_px: float, ids: tuple[int, ...] = (0, 1)) -> IdealTracks:
    """Two lines of twelve are not at rest: they sway across themselves, twice a second."""
    made = ideal_tracks(seed, hand_held(np.random.default_rng(seed)))
    for i in ids:
        track = made.tracks[i]
        for n, seen in enumerate(track.sightings):
            along = seen.points[-1] - seen.points[0]
            across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
            phase = 4.0 * np.pi * seen.stamp * 1e-9 + i
            moved = seen.points + off_px / FOCAL_LENGTH * np.sin(phase) * across
            track.sightings[n] = sighting(seen.stamp, moved)
    return made


def weights(window: Window) -> dict[int, float]:
    return {id_: line.weight for id_, line in window.lines.items()}


def test_lines_that_sway_count_for_little_and_the_others_for_as_much_as_ever():
    made = wandering(0, off_px=2.0)
    ids = [track.id for track in made.tracks]
    found = weights(run_window(made, load_config(None, SETTINGS))[0])
    others = [found[id_] for id_ in ids[2:]]
    assert max(found[id_] for id_ in ids[:2] if id_ in found) < 0.2
    assert min(others) > 0.5
    assert np.median(others) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_the_estimate_is_better_for_it(seed):
    """Than with equal weights, which a prior of a million intervals means."""
    errors = []
    for prior in (5, 1_000_000):
        made = wandering(seed, off_px=2.0)
        window, _ = run_window(made, load_config(None, [*SETTINGS, f"lines.weight_prior={prior}"]))
        node = window.newest
        errors.append(error_of(node.state.pose(), made.motion.pose(node.time)))
    assert errors[0] < 0.7 * errors[1]


def test_weights_are_those_of_student_s_t():
    """Each line's squares and points summed here in another way."""
    window, _ = run_window(wandering(1, off_px=1.0), load_config(None, SETTINGS))
    reweigh(window.intervals, window.lines.values(), prior=3.0)
    mean_squares, counts = {}, {}
    for id_, line in window.lines.items():
        squares = points = counts[id_] = 0
        for interval in window.intervals:
            for seen in interval.observations:
                if seen.line is line and seen.factor.keys()[-1] == line.key:
                    state = interval.state(line.delta)
                    squares += np.sum(seen.factor.evaluate(state, False).value ** 2)
                    points += sum(
                        np.linalg.norm(frame[:, 2]) ** 2 for frame in seen.points.statistics
                    )
                    counts[id_] += 1
        mean_squares[id_] = squares / points
    usual = np.median(list(mean_squares.values()))
    for id_, weight in weights(window).items():
        n = counts[id_]
        expected = min(1.0, (3.0 + n) / (3.0 + n * mean_squares[id_] / usual))
        assert weight == pytest.approx(expected, rel=1e-9)


def test_factors_have_the_weight_of_their_line():
    window, _ = run_window(wandering(2, off_px=1.0), load_config(None, SETTINGS))
    factors = [seen for interval in window.intervals for seen in interval.observations]
    assert len(factors) > 30
    for seen in factors:
        if seen.factor.keys()[-1] == seen.line.key:
            assert seen.factor.weight == pytest.approx(seen.line.weight)


def test_nothing_happens_without_lines():
    window, _ = run_window(wandering(0, off_px=1.0), load_config(None, SETTINGS))
    before = weights(window)
    reweigh([], window.lines.values(), prior=5.0)
    reweigh(window.intervals, [], prior=5.0)
    assert weights(window) == before
