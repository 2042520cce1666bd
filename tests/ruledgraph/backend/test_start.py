# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np

from ruledgraph.backend.start import InitialLine
from ruledgraph_factors import LineChart


def test_an_initial_line_is_at_zero_of_its_chart_however_far_it_went():
    rng = np.random.default_rng(0)
    pose = gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), rng.normal(size=3))
    chart = LineChart(pose, np.eye(3), 0.3)
    delta = np.array([-0.4, -0.6, -5.5, 2.9])  # almost a full turn
    root = rng.normal(size=(4, 4))
    line = InitialLine.at(chart, delta, root @ root.T)
    before, by_before = chart.plucker(delta)
    after, by_after = line.chart.plucker(np.zeros(4))
    # Up to the sign of its direction, which says nothing of a line.
    sign = np.sign(before @ after)
    np.testing.assert_allclose(sign * after, before, atol=1e-9)
    # What is known of it in the world is the same.
    np.testing.assert_allclose(
        by_after @ line.covariance @ by_after.T,
        by_before @ root @ root.T @ by_before.T,
        atol=1e-9,
    )
