# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Edges of many lines in arrays: what of each line is where."""

import numpy as np
import pytest

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.frontend import kernel
from ruledgraph.frontend.edge_batch import Edges, Rulings, clipped, moved_ends, search_all, stacked
from ruledgraph.frontend.edge_search import search
from ruledgraph.frontend.gradient import Gradient
from ruledgraph_factors import GeometricPoints

ENDS = np.array(
    [[[-0.3, -0.2], [0.3, -0.15]], [[-0.3, 0.25], [0.3, 0.3]], [[-0.2, 0.0], [0.2, 0.1]]]
)


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> tuple[Rulings, list, Edges]:
    """Three rulings, of which the second is on no edge, what is found one by one and at once."""
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "numpy")
    lines = [(line_through(*ENDS[i]), 60.0) for i in (0, 2)]
    gradient = Gradient(edge_image(CAMERA, lines))
    rulings = Rulings(ENDS, np.full((3, 2), 2.0), np.array([20.0, 20.0, 20.0]))
    one_by_one = [search(gradient, CAMERA, ruling) for ruling in rulings.one_by_one()]
    assert [found is None for found in one_by_one] == [False, True, False]
    return rulings, one_by_one, search_all(gradient, CAMERA, rulings)


def test_every_line_has_its_own_row(both):
    rulings, one_by_one, edges = both
    assert edges.counts[1] == 0
    points = edges.points_of_each()
    assert points[1].shape == (0, 2)
    for i in (0, 2):
        np.testing.assert_array_equal(points[i], one_by_one[i].points)
        assert tuple(edges.lines[i]) == one_by_one[i].line
        assert edges.support[i] == one_by_one[i].support
        assert edges.rms_px[i] == one_by_one[i].rms_px
        assert edges.slopes[i] == one_by_one[i].slope
        C = GeometricPoints.from_frames([points[i]]).statistics[0]
        np.testing.assert_allclose(edges.statistics[i].T @ edges.statistics[i], C.T @ C, atol=1e-12)
        np.testing.assert_array_equal(edges.ends[i], moved_ends(rulings.ends[i], points[i], 0.3))


def test_a_part_is_what_is_found_of_a_part(both):
    rulings, one_by_one, edges = both
    for rows in ([True, False, False], [False, True, True], [False, False, False]):
        mask = np.array(rows)
        chosen = [found for found, row in zip(one_by_one, rows, strict=True) if row]
        for mine, other in zip(edges.part(mask), stacked(rulings.part(mask), chosen), strict=True):
            np.testing.assert_array_equal(mine, other)
            assert mine.shape == other.shape


def test_ends_go_onto_the_line_and_towards_its_outermost_points():
    # A line along x at y = 1, predicted slanted and too short; its outermost points are strays.
    along = np.array([-5.0, *range(1, 10), 14.0])
    points = np.column_stack([along, np.ones(11)])
    ends = np.array([[3.0, 1.2], [7.0, 0.7]])
    expected = [[3.0 + 0.3 * (0.0 - 3.0), 1.0], [7.0 + 0.3 * (10.0 - 7.0), 1.0]]
    np.testing.assert_allclose(moved_ends(ends, points, 0.3), expected, atol=1e-12)
    # The other way round, and steep.
    backwards = moved_ends(ends[::-1], points[::-1], 0.3)
    np.testing.assert_allclose(backwards, expected[::-1], atol=1e-12)
    steep = moved_ends(ends[:, ::-1], points[:, ::-1], 0.3)
    np.testing.assert_allclose(steep, np.array(expected)[:, ::-1], atol=1e-12)


def test_the_ends_of_a_short_line_stay_where_they_are():
    """Its stations reach a little beyond it, and those on it have points."""
    ends = np.array([[0.0, 1.0], [10.0, 1.0]])
    for _ in range(50):
        stations = np.linspace(ends[0, 0] - 0.6, ends[1, 0] + 0.6, 13)
        on_it = stations[(stations >= 0.0) & (stations <= 10.0)]
        ends = moved_ends(ends, np.column_stack([on_it, np.ones(len(on_it))]), 0.3)
    # By no more than stations are apart.
    np.testing.assert_allclose(ends, [[0.0, 1.0], [10.0, 1.0]], atol=0.9)


LOW, HIGH = np.array([-0.5, -0.4]), np.array([0.5, 0.4])
CLIPPED = [
    # Inside; across the right border; across two borders; outside; past a corner.
    ([[-0.3, 0.0], [0.3, 0.2]], [[-0.3, 0.0], [0.3, 0.2]]),
    ([[0.0, 0.1], [1.0, 0.3]], [[0.0, 0.1], [0.5, 0.2]]),
    ([[-1.0, -0.2], [1.0, 0.2]], [[-0.5, -0.1], [0.5, 0.1]]),
    ([[-0.3, 0.5], [0.3, 0.6]], None),
    ([[0.4, -0.6], [0.7, -0.3]], None),
    # Along an axis, inside and outside; nowhere.
    ([[-0.3, 0.1], [0.9, 0.1]], [[-0.3, 0.1], [0.5, 0.1]]),
    ([[-0.3, 0.7], [0.9, 0.7]], None),
    ([[0.2, -0.9], [0.2, 0.9]], [[0.2, -0.4], [0.2, 0.4]]),
    # A point, and a sliver at the border.
    ([[0.1, 0.1], [0.1, 0.1]], [[0.1, 0.1], [0.1, 0.1]]),
    ([[0.4999999, 0.1], [0.9, 0.1]], None),
    ([[np.nan, 0.1], [0.3, 0.2]], None),
    ([[np.inf, 0.1], [0.3, 0.2]], None),
]


@pytest.mark.parametrize("name", ["native", "numpy"])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_of_segments_the_part_in_view_is_kept(monkeypatch, name):
    if name == "native" and kernel.native is None:
        pytest.skip("the native kernel was not built (no C++ compiler)")
    monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
    parts, visible = clipped(np.array([ends for ends, _ in CLIPPED]), LOW, HIGH)
    assert visible.tolist() == [part is not None for _, part in CLIPPED]
    for own, (ends, part) in zip(parts, CLIPPED, strict=True):
        # One that is out of view stays as it is.
        np.testing.assert_allclose(own, ends if part is None else part, rtol=0.0, atol=1e-12)
    assert clipped(np.zeros((0, 2, 2)), LOW, HIGH)[0].shape == (0, 2, 2)
