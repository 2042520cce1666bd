# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A drawing in three views to one scale: the front below the top view, the side right of it."""

from typing import Any

from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple

from ruledgraph.core.arrays import FloatArray

# Inches: the widest and tallest the drawing may get, the gap between views, the margins.
_WIDTH, _HEIGHT = 11.0, 9.4
_GAP, _LEFT, _BOTTOM, _TOP, _RIGHT = 0.65, 0.7, 0.55, 1.05, 0.25
# A colour bar, with what lies to both its sides, and the widest entry of a legend.
_BAR = 2.4
_BAR_AND_GAP, _ENTRY = _BAR + 0.85, 1.12
# Labels of ticks fit into so much, along x and y.
_TICK = (0.6, 0.4)
_MOST_TICKS = 6


class ThreeViews:
    """Axes for what lies in a box.

    Args:
        low: corner of the box, m, (3,).
        high: the other corner.
    """

    def __init__(self, low: FloatArray, high: FloatArray) -> None:
        size = high - low
        # Inches a metre.
        scale = min(
            (_WIDTH - _LEFT - _RIGHT - _GAP) / (size[0] + size[1]),
            (_HEIGHT - _BOTTOM - _TOP - _GAP) / (size[1] + size[2]),
        )
        wide, deep, tall = (scale * size).tolist()
        self._size = _LEFT + wide + _GAP + deep + _RIGHT, _BOTTOM + tall + _GAP + deep + _TOP
        self.figure = Figure(figsize=self._size)
        upper, right = _BOTTOM + tall + _GAP, _LEFT + wide + _GAP
        self._corner = right, upper, deep, deep
        self.views = (
            (self._axes(_LEFT, upper, wide, deep), 0, 1),
            (self._axes(right, _BOTTOM, deep, tall), 1, 2),
            (self._axes(_LEFT, _BOTTOM, wide, tall), 0, 2),
        )
        """Top, side and front: axes, and which coordinates lie along and up."""
        for (axes, a, b), name in zip(self.views, ("top", "side", "front"), strict=True):
            axes.set(xlim=(low[a], high[a]), ylim=(low[b], high[b]), title=name, aspect="equal")
            axes.set(xlabel=f"{'xyz'[a]} (m)", ylabel=f"{'xyz'[b]} (m)")
            set_ticks(axes, *(scale * size[[a, b]]))

    def corner(self) -> Any:
        """Axes in the corner that the views leave, a square."""
        axes = self._axes(*self._corner)
        set_ticks(axes, *self._corner[2:])
        return axes

    def legend(self, handles: list[Any], labels: list[str]) -> None:
        """Above the views."""
        room = self._size[0] - _BAR_AND_GAP
        columns = max(n for n in (1, 2, 3, 6) if n == 1 or n * _ENTRY <= room)
        self.figure.legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=(0.02, 0.995),
            ncols=columns,
            # Of a handle that is several lines, one beside the other.
            handler_map={tuple: HandlerTuple(ndivide=None, pad=0.0)},
        )

    def color_bar(self, drawn: Any, label: str) -> None:
        """Above the views, on the right."""
        width, height = self._size
        bar = self._axes(width - 0.35 - _BAR, height - 0.42, _BAR, 0.13)
        self.figure.colorbar(drawn, cax=bar, orientation="horizontal")
        bar.text(0.0, 1.4, label, transform=bar.transAxes, ha="left", va="bottom")

    def _axes(self, left: float, bottom: float, across: float, up: float) -> Any:
        """At a place in inches."""
        width, height = self._size
        return self.figure.add_axes((left / width, bottom / height, across / width, up / height))


def set_ticks(axes: Any, across: float, up: float) -> None:
    """As many ticks as have room on axes of this size, inches."""
    for axis, length, room in (("x", across, _TICK[0]), ("y", up, _TICK[1])):
        axes.locator_params(axis=axis, nbins=min(max(int(length / room), 1), _MOST_TICKS))
