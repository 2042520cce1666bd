# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the graph as they are handed out."""

import gtsam
import numpy as np

from ruledgraph.backend.landmarks import Landmark, record_extent
from ruledgraph.core.arrays import FloatArray
from ruledgraph_factors import LineChart

CENTRE = np.array([0.1, -0.3, -0.2])


def view_of(ends: FloatArray) -> FloatArray:
    """A camera's centre and rays to both ends, of any length and in any order."""
    return np.stack([CENTRE, 0.3 * (ends[1] - CENTRE), 2.0 * (ends[0] - CENTRE)])


def test_the_covariance_of_a_lines_ends_is_that_of_drawn_lines():
    rng = np.random.default_rng(4)
    anchor = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.1, -0.2, 0.3), np.array([0.1, 0.2, 0.3]))
    first, second = np.array([0.5, -0.4, 2.5]), np.array([0.7, 0.6, 2.2])
    chart = LineChart.from_points(anchor, first, second)
    root = 1e-3 * rng.normal(size=(4, 4))
    line = Landmark(1, 1, chart, np.zeros(4), root @ root.T, 0, 0, 0.0)
    extent = np.array([-0.6, 0.5])
    line.record_view(view_of(chart.end_points(np.zeros(4), extent)[0]))
    estimate = line.estimate(0.05)
    assert estimate is not None
    count = 4_000
    drawn = np.array([chart.end_points(root @ x, extent)[0] for x in rng.normal(size=(count, 4))])
    np.testing.assert_allclose(drawn.mean(axis=0), estimate.ends, atol=1e-3)
    for end in range(2):
        sample, own = np.cov(drawn[:, end].T), estimate.covariance[end]
        # A sample covariance is off by sqrt(2 / count), 2 % of its size; five of them.
        np.testing.assert_allclose(sample, own, atol=0.11 * np.linalg.norm(own, 2))


def test_a_line_ends_where_it_was_seen_furthest_but_for_one_sighting_in_twenty():
    first, second = np.array([-1.0, 0.2, 3.0]), np.array([1.0, 0.4, 2.5])
    chart = LineChart.from_points(gtsam.Pose3(), first, second)
    line = Landmark(1, 1, chart, np.zeros(4), 1e-6 * np.eye(4), 0, 0, 0.0)
    # Most sightings are of a part; 3 of 100 go far beyond the line.
    for i, share in enumerate(np.linspace(0.0, 1.0, 100)):
        reach = [-2.0, 3.0] if i % 40 == 0 else [-0.6 + 0.3 * share, 0.2 + 0.3 * share]
        line.record_view(view_of(chart.end_points(np.zeros(4), reach)[0]))
    estimate = line.estimate(0.05)
    assert estimate is not None
    ends, _ = chart.end_points(np.zeros(4), np.array([-0.6, 0.5]))
    # m; a twentieth of 0.3 m.
    np.testing.assert_allclose(estimate.ends, ends, atol=0.015)


def test_a_line_that_was_taken_for_another_at_first_ends_where_it_was_seen():
    """At rest its distance is a guess: twice too far, it would be twice too long."""
    first, second = np.array([-0.5, 0.2, 2.0]), np.array([0.5, 0.2, 2.0])
    camera, ends = gtsam.Pose3(), np.array([first[:2], second[:2]]) / 2.0
    wrong = LineChart.from_points(camera, 2.0 * first, 2.0 * second)
    line = Landmark(1, 1, wrong, np.zeros(4), 1e-6 * np.eye(4), 0, 0, 0.0)
    for _ in range(10):
        record_extent([line], [camera], ends[None])
    line.chart = LineChart.from_points(camera, first, second)
    estimate = line.estimate(0.05)
    assert estimate is not None
    np.testing.assert_allclose(estimate.ends, [first, second], atol=1e-9)  # m; rounding


def test_a_line_without_a_known_extent_is_not_handed_out():
    chart = LineChart.from_points(
        gtsam.Pose3(), np.array([0.0, 0.0, 2.0]), np.array([1.0, 0.0, 2.0])
    )
    assert Landmark(1, 1, chart, np.zeros(4), np.eye(4), 0, 0, 0.0).estimate(0.05) is None
