# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the graph as they are handed out."""

import gtsam
import numpy as np

from ruledgraph.backend.landmarks import Landmark
from ruledgraph_factors import LineChart


def test_the_covariance_of_a_lines_ends_is_that_of_drawn_lines():
    rng = np.random.default_rng(4)
    anchor = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.1, -0.2, 0.3), np.array([0.1, 0.2, 0.3]))
    first, second = np.array([0.5, -0.4, 2.5]), np.array([0.7, 0.6, 2.2])
    chart = LineChart.from_points(anchor, first, second)
    root = 1e-3 * rng.normal(size=(4, 4))
    line = Landmark(1, 1, chart, np.zeros(4), root @ root.T, 0, 0, 0.0)
    extent = np.array([-0.6, 0.5])
    line.record_extent(extent)
    estimate = line.estimate(0.05)
    assert estimate is not None
    count = 4_000
    drawn = np.array([chart.end_points(root @ x, extent)[0] for x in rng.normal(size=(count, 4))])
    np.testing.assert_allclose(drawn.mean(axis=0), estimate.ends, atol=1e-3)
    for end in range(2):
        sample, own = np.cov(drawn[:, end].T), estimate.covariance[end]
        # A sample covariance is off by sqrt(2 / count), 2 % of its size; five of them.
        np.testing.assert_allclose(sample, own, atol=0.11 * np.linalg.norm(own, 2))
