# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What stands above three views does not overlap, however wide they are."""

import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ruledgraph.core import figure_style as style
from ruledgraph.visualization.three_views import ThreeViews

NAMES = ["line map", "truth", "live", "smoothed", "start", "end"]


@pytest.mark.parametrize("size", [(5, 4, 2), (1, 1, 1), (0.3, 1, 0.3), (4, 1, 1), (1, 3, 1)])
def test_legend_and_colour_bar_do_not_overlap(size):
    with style.figure_style():
        drawing = ThreeViews(np.zeros(3), np.array(size, dtype=float))
        axes = drawing.views[0][0]
        drawn = axes.scatter([0, 1], [0, 1], c=[0, 1])
        handles = [axes.plot([0, 1], label=name)[0] for name in NAMES]
        drawing.legend(handles, NAMES)
        drawing.color_bar(drawn, "position error (mm)")
        renderer = FigureCanvasAgg(drawing.figure).get_renderer()
        drawing.figure.draw(renderer)
        legend = drawing.figure.legends[0].get_window_extent(renderer)
        bar = drawing.figure.axes[-1].get_tightbbox(renderer)
        close = drawing.corner()
        close.plot([0.0, 0.33], [-0.5, 0.4])
        close.set(title="enlarged", xlabel="x (m)", ylabel="z (m)")
        drawing.figure.draw(renderer)
        drawn_axes = [*(view for view, *_ in drawing.views), close]
        titles = [each.title.get_window_extent(renderer) for each in drawn_axes]
        labels = [each.xaxis.label.get_window_extent(renderer) for each in drawn_axes]
        for each in drawn_axes:
            ticks = [
                tick.label1.get_window_extent(renderer)
                for tick in each.xaxis.get_major_ticks()
                if tick.label1.get_text()
            ]
            assert not any(a.overlaps(b) for a, b in itertools.pairwise(ticks))
    whole = drawing.figure.bbox
    assert all(whole.x0 <= box.x0 and box.x1 <= whole.x1 for box in (*titles, *labels))
    assert not any(title.overlaps(label) for title in titles for label in labels)
    assert not legend.overlaps(bar)
    for view, *_ in drawing.views[:2]:
        title = view.title.get_window_extent(renderer)
        assert not title.overlaps(legend)
        assert not title.overlaps(bar)
