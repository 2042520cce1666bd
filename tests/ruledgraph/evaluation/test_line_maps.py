# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of lines against the true ones."""

import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.evaluation.line_maps import line_map_accuracy, points_in_view

TRUE = np.array(
    [
        [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0]],
        [[0.0, 1.0, 2.0], [1.0, 1.0, 2.0]],
        [[0.0, 2.0, 2.0], [1.0, 2.0, 2.0]],
        [[0.0, 3.0, 2.0], [1.0, 3.0, 2.0]],
    ]
)
SEEN = np.array([True, True, True, False])


def test_shares_of_lines_that_are_true_and_of_true_ones_that_are_found():
    ends = np.array(
        [
            [[0.1, 0.01, 2.0], [0.5, 0.01, 2.0]],
            [[0.9, 0.0, 2.01], [0.4, 0.0, 2.01]],  # the same one again, the other way round
            [[0.0, 1.03, 2.0], [1.02, 1.0, 2.0]],
            [[0.0, 2.03, 2.0], [0.0, 1.98, 2.0]],  # short, close, and across
            [[0.0, 1.5, 2.0], [1.0, 1.5, 2.0]],
        ]
    )
    found = line_map_accuracy(ends, TRUE, SEEN)
    assert (found.lines, found.precision, found.repeats) == (5, 3 / 5, 3 / 2)
    assert found.recall == pytest.approx(2 / 3)
    assert found.distance == pytest.approx(0.01)  # of 10, 10, 10, 10, 30 and 20 mm


def test_without_lines_nothing_is_found():
    found = line_map_accuracy(np.empty((0, 2, 3)), TRUE, SEEN)
    assert (found.lines, found.recall) == (0, 0.0)
    assert np.isnan([found.precision, found.repeats, found.distance]).all()


def test_what_is_in_the_image_of_some_view():
    camera = CameraModel(640, 480, 400.0, 400.0, 320.0, 240.0)
    points = np.array([[0.0, 0.0, 2.0], [1.7, 0.0, 2.0], [0.0, 0.0, -2.0], [0.0, 0.0, 0.1]])
    views = np.stack([np.eye(3)] * 2), np.zeros((2, 3))
    np.testing.assert_array_equal(
        points_in_view(points, camera, *views), [True, False, False, False]
    )
    views[1][1, 0] = 0.5
    np.testing.assert_array_equal(
        points_in_view(points, camera, *views), [True, True, False, False]
    )
