# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines that err more than the others count for less, and all of a noisy camera."""

import numpy as np
import pytest

from ideal_tracks import IdealTracks, error_of, ideal_tracks, sighting
from ruledgraph.backend.line_weights import LineWeights
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.settings import load_config
from simulated_window import FOCAL_LENGTH, hand_held
from window_runs import run_window

SETTINGS = ["edges.sigma_px=0.5", "lines.cauchy_scale_px=0", "edges.variance_prior=1e9"]


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


@pytest.mark.parametrize("still", [0, 2])
def test_weights_and_the_noise_of_edges_are_those_of_student_s_t(still):
    """Each line's squares and points summed here in another way."""
    window, _ = run_window(wandering(1, off_px=1.0), load_config(None, SETTINGS))
    for interval in list(window.intervals)[:still]:
        interval.still = True
    config = load_config(None, ["edges.sigma_px=0.5", "lines.weight_prior=3"])
    LineWeights(0.5 / FOCAL_LENGTH, 1.0, config).update(window.intervals, window.lines.values())
    mean_squares, counts, moving = {}, {}, {}
    dof = -15.0
    for id_, line in window.lines.items():
        squares = points = counts[id_] = moving[id_] = 0
        for n, interval in enumerate(window.intervals):
            for seen in interval.observations:
                if seen.line is line and seen.factor.keys()[-1] == line.key:
                    state = interval.state(line.delta)
                    own = np.sum(seen.factor.evaluate(state, False).value ** 2)
                    squares += own
                    points += sum(
                        np.linalg.norm(frame[:, 2]) ** 2 for frame in seen.points.statistics
                    )
                    counts[id_] += 1
                    if n >= still:
                        moving[id_] += own
                        dof += 2.0 * seen.points.frames
        dof -= 4.0
        mean_squares[id_] = squares / points
    usual = np.median(list(mean_squares.values()))
    relative = {
        id_: min(1.0, (3.0 + n) / (3.0 + n * mean_squares[id_] / usual))
        for id_, n in counts.items()
    }
    squares = sum(relative[id_] * moving[id_] for id_ in relative) / (0.5 / FOCAL_LENGTH) ** 2
    variance = (5.0 + squares) / (5.0 + dof / 8.0)
    for id_, weight in weights(window).items():
        assert weight == pytest.approx(relative[id_] / variance, rel=1e-9)


@pytest.mark.parametrize("sigma_px", [0.25, 0.5, 2.0])
def test_the_noise_of_edges_is_found_whatever_the_figure(sigma_px):
    """0.5 px, independent from frame to frame: so large are the residuals."""
    made = ideal_tracks(0, hand_held(np.random.default_rng(0)))
    settings = [f"edges.sigma_px={sigma_px}", "edges.correlation=1", "edges.variance_prior=0.1"]
    window, _ = run_window(made, load_config(None, settings))
    found = sigma_px * np.sqrt(window.line_manager.weights.edge_variance)
    # Lines that scatter more by chance count for less, and so would their share of the noise.
    assert found == pytest.approx(0.5, rel=0.1)


def test_at_rest_residuals_say_nothing_of_the_noise():
    window, _ = run_window(wandering(1, off_px=1.0), load_config(None, SETTINGS))
    for interval in window.intervals:
        interval.still = True
    made = LineWeights(0.5 / FOCAL_LENGTH, 4.0, load_config(None, []))
    made.update(window.intervals, window.lines.values())
    assert made.edge_variance == 4.0
    assert max(weights(window).values()) == 0.25


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
    made = LineWeights(0.5 / FOCAL_LENGTH, 1.0, load_config(None, []))
    made.update([], window.lines.values())
    made.update(window.intervals, [])
    assert weights(window) == before
