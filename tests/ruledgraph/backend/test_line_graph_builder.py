# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A line that gets a new variable."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L

from ideal_tracks import ideal_tracks
from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_factors import EdgeModel
from ruledgraph.backend.line_graph_builder import LineGraphBuilder
from ruledgraph.core.config import LinesConfig
from ruledgraph_factors import LineChart
from simulated_window import hand_held
from window_runs import run_window


@pytest.mark.parametrize("size", [0.1, 0.3])
def test_it_keeps_what_was_known_but_for_terms_of_the_second_order(size):
    """The marginal of the old variable, linearised at zero, and the tie."""
    chart = LineChart.from_points(gtsam.Pose3(), [-0.5, 0.3, 3.0], [0.7, 0.5, 4.0])
    moved = size * np.array([0.6, 0.0, 0.0, 0.8])
    known = np.diag([1e-2, 3e-4, 3e-4, 2e-2]) ** 2
    line = Landmark(1, L(7), chart, moved, known, 0, 0, 1.0, linearization_frozen=True)
    update = GraphUpdate()
    builder = LineGraphBuilder(EdgeModel(gtsam.Pose3(), 400.0, 1e-3, 1e-3), LinesConfig(), {})
    builder.recentre(line, [], update)
    assert line.key != L(7)

    update.factors.addPriorVector(L(7), moved, gtsam.noiseModel.Gaussian.Covariance(known))
    values = gtsam.Values(update.values)
    values.insert(L(7), moved)
    found = gtsam.Marginals(update.factors, values).marginalCovariance(line.key)
    _, by_old = chart.reanchor(moved, gtsam.Pose3())
    expected = by_old @ known @ by_old.T + (0.5 * size**2) ** 2 * np.eye(4)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(line.covariance, expected, atol=1e-12)


def test_images_in_the_window_are_moved_to_the_new_variable():
    """They mean the same there; those that count are removed from the old one."""
    made = ideal_tracks(0, hand_held(np.random.default_rng(0)))
    window, _ = run_window(made)
    line = window.lines[3]
    line.weight = 4.0
    line.delta = line.delta + np.array([0.05, -0.03, 0.02, 0.1])
    seen = [(i, own) for i in window.intervals for own in i.observations if own.line is line]
    assert len(seen) > 5
    seen[1][1].in_graph = False
    old = [own.factor for _, own in seen]
    before = [own.factor.evaluate(i.state(line.delta), False).value for i, own in seen]
    update = GraphUpdate()
    update.factors.add(old[-1])
    window.line_manager._builder.recentre(line, window.intervals, update)
    assert update.removal.factors == [old[0], *old[2:-1]]
    new = [update.factors.at(i) for i in range(update.factors.size())]
    assert old[-1] not in new
    for (interval, own), value in zip(seen, before, strict=True):
        assert own.factor.spec.line_key == line.key
        assert own.factor.weight == 4.0
        assert (own.factor in new) == own.in_graph
        found = own.factor.evaluate(interval.state(line.delta), False).value
        np.testing.assert_allclose(found, value, atol=1e-9)
