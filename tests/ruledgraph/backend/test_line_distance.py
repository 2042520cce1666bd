# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far away a new line is expected: as far as the others are."""

import gtsam
import numpy as np
import pytest

from ideal_tracks import MANY, ideal_tracks
from ruledgraph.backend.line_distance import InverseDistance, usual_distance
from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.settings import load_config
from ruledgraph_factors import LineChart, LineDistanceSpec, spec_of
from simulated_window import hand_held
from window_runs import run_window


def test_an_inverse_distance_and_its_deviation():
    """Through (0, 0, 4): 1/4, and by the derivative of tan(phi) at it."""
    chart = LineChart.from_points(gtsam.Pose3(), [0.0, 0.0, 4.0], [1.0, 0.0, 4.0])
    found = InverseDistance.of(chart, np.zeros(4), np.diag([0.01, 1.0, 1.0, 1.0]) ** 2)
    assert found.value == pytest.approx(0.25)
    assert found.sigma == pytest.approx(0.01 * (1.0 + 0.25**2))
    assert found.is_known
    assert not InverseDistance(0.25, 0.1).is_known
    assert not InverseDistance(-0.25, 0.01).is_known


def test_the_geometric_mean_with_the_prior_as_one_line():
    known = [InverseDistance(1.0 / d, 1e-3) for d in (1.0, 2.0, 8.0)]
    unknown = [InverseDistance(1e-3, 1.0), InverseDistance(-0.2, 0.01)]
    assert usual_distance([*known, *unknown], 3.0) == pytest.approx((3 * 1 * 2 * 8) ** 0.25)
    assert usual_distance(unknown, 3.0) == pytest.approx(3.0)


@pytest.mark.parametrize("nearer", [0.5, 3.0])
def test_lines_that_enter_later_are_expected_where_the_others_are(nearer):
    """Twelve lines of the scene, and the same again half a second later; those expect the mean
    distance of these, however large the scene is.
    """
    made = ideal_tracks(0, hand_held(np.random.default_rng(0)), segments=MANY * nearer)
    for track in list(made.tracks):
        late = [seen for seen in track.sightings if seen.stamp > 5e8]
        made.tracks.append(track._replace(id=track.id + 100, first_time=0.5, sightings=late))
    window, _ = run_window(made, load_config(None, ["edges.sigma_px=0.5", "window.lag=5"]))
    spec_by_key = distances(window)
    found = [spec_by_key[line.key].distance for id_, line in window.lines.items() if id_ > 100]
    inverse = [line.inverse_distance().value for line in window.lines.values()]
    true = float(np.exp(-np.mean(np.log(inverse))))
    assert len(found) > 5
    # The prior of 3 m is one among twelve, some of which are not known after half a second.
    assert found == pytest.approx([true] * len(found), rel=1 / 3)
    assert not 2 / 3 < true / 3.0 < 4 / 3


def distances(window: Window) -> dict[int, LineDistanceSpec]:
    """Of the window's lines, by their keys."""
    graph = window._solver._smoother._smoother.getFactors()
    specs = [spec_of(graph.at(i)) for i in range(graph.size()) if graph.exists(i)]
    found = [spec for spec in specs if isinstance(spec, LineDistanceSpec)]
    return {spec.keys[1]: spec for spec in found if gtsam.Symbol(spec.keys[1]).chr() == ord("l")}
