# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Colours and the look of all figures, in one place."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from ruledgraph.core.errors import machine_error

Color = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

INK, MUTED, LIVE, SMOOTHED, TRUTH = "#1a2230", "#7b8698", "#12a37f", "#1f5fd0", "#111111"
START, END = "#149447", "#d62839"
LINES = "#8fa0bb"
AXES = ("#d1495b", "#2a9d5c", "#2f6fde")
"""Of x, y and z."""
SERIES = ("#1f5fd0", "#e8710a", "#149447", "#8e3fc4", "#d62839", "#0f95a8", "#8a6d1b", "#e0489b")
"""Of trajectories that are compared."""
SEQUENTIAL = "plasma"
"""Matplotlib's name of the colour map for time and errors."""

STATUS_COLORS = {
    "tracking": "#2563c9",
    "still": "#8a95a8",
    "dead reckoning": "#e07b00",
    "degraded": "#c2185b",
}
"""Of the status of an estimate."""
MISSING = "#f3c6c6"
"""Of frames without an estimate."""

# Strong on grey images and on white. Yellow belongs to lines that are not in the graph yet.
_LINE_COLORS = (
    *("#ff3b30", "#2f9bff", "#34d158", "#ff6fd8", "#ff9500", "#a45cff", "#00d5d5", "#8ee01a"),
    *("#ff5c8a", "#5b74ff", "#00c98b", "#e83fe0", "#ff7a4d", "#38c6ff", "#b98bff", "#5fc400"),
    *("#ff2e63", "#19e3a0", "#e08a1e", "#8f9bff"),
)

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "text.color": INK,
    "axes.edgecolor": "#b8c0cc",
    "axes.labelcolor": "#4a5568",
    "axes.titlecolor": INK,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.linewidth": 0.8,
    "grid.color": "#e6e9ef",
    "grid.linewidth": 0.8,
    "xtick.color": "#4a5568",
    "ytick.color": "#4a5568",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Within it all figures are drawn in one style; the user's own settings are kept."""
    with mpl.rc_context(_RC):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches, whose parts do not overlap."""
    return Figure(figsize=(width, height), layout="constrained")


def line_color(number: int) -> Color:
    """Of a line, the same wherever it is drawn."""
    return rgb(_LINE_COLORS[number % len(_LINE_COLORS)])


def status_color(status: str) -> str:
    """Of a status; grey for one that is not known here."""
    return STATUS_COLORS.get(status, MUTED)


def rgb(color: str) -> Color:
    """Of a colour written as #rrggbb."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def save_figure(figure: Figure, path: Path, dpi: int) -> None:
    """Write a PNG that is whole, or none.

    Raises:
        MachineError: without space.
    """
    try:
        figure.savefig(path, dpi=dpi)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise (machine_error(error, path) or error) from None
