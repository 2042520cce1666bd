# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The trajectory to turn and zoom: a Plotly figure inside the page, with Plotly itself."""

import base64
import gzip
import json
from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex

from ruledgraph.core import figure_style as style
from ruledgraph.core.arrays import FloatArray
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.run_tables import RunTables
from ruledgraph.visualization.trajectory_figure import DrawnPath, path_of, shown_lines, view_box

# Poses of a path that are drawn.
_MAX_POSES = 2500
_DIGITS = 4


@cache
def plotly_library() -> str:
    """Plotly's script, compressed by gzip, in base64: a third of its size."""
    from plotly.offline import get_plotlyjs

    packed = gzip.compress(get_plotlyjs().encode("utf-8"), mtime=0)
    return base64.b64encode(packed).decode("ascii")


def trajectory_json(run: RunTables, truth: GroundTruth | None) -> str:
    """The figure as JSON that may stand inside a script element."""
    path = path_of(run, truth)
    ends = shown_lines(run)
    low, high = view_box(path.smoothed, ends)
    middle = ends.mean(axis=1)
    ends = ends[((middle > low) & (middle < high)).all(axis=1)]
    traces = [_lines(ends)] if len(ends) else []
    if path.truth is not None:
        traces.append(_path(path.truth, "truth", "#888888", 7) | {"opacity": 0.45})
    traces += [_path(path.live, "live", style.LIVE, 2), _colored(path), _legend_of_smoothed()]
    for at, name, color, symbol in (
        (0, "start", style.START, "circle"),
        (-1, "end", style.END, "square"),
    ):
        marker = {"size": 4, "color": color, "symbol": symbol}
        traces.append(
            _scatter(path.smoothed[[at]], name, mode="markers", marker=marker, hoverinfo="name")
        )
    return json.dumps({"data": traces, "layout": _layout()}).replace("<", "\\u003c")


def _layout() -> dict[str, Any]:
    def axis(name: str) -> dict[str, Any]:
        # The page sets colours, which depend on whether it is light or dark.
        title = {"text": f"{name} (m)"}
        return {"title": title, "nticks": 6, "showbackground": False, "zeroline": False}

    return {
        "scene": {
            **{f"{name}axis": axis(name) for name in "xyz"},
            "aspectmode": "data",
            "camera": {
                "eye": {"x": -1.15, "y": -1.8, "z": 1.1},
                # To the left of the middle: axes are labelled there.
                "center": {"x": -0.15, "y": 0.1, "z": -0.12},
            },
        },
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"orientation": "h", "x": 0.02, "y": 0.99, "yanchor": "top"},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "uirevision": "kept",
    }


def _scatter(points: FloatArray, name: str, **more: Any) -> dict[str, Any]:
    x, y, z = np.round(points, _DIGITS).T.tolist()
    return {"type": "scatter3d", "x": x, "y": y, "z": z, "name": name} | more


def _path(points: FloatArray, name: str, color: str, width: int) -> dict[str, Any]:
    line = {"color": color, "width": width}
    return _scatter(_thinned(points), name, mode="lines", line=line, hoverinfo="name")


def _colored(path: DrawnPath) -> dict[str, Any]:
    values = np.round(_thinned(path.values), 3).tolist()
    bar = {"title": {"text": path.label, "side": "right"}, "thickness": 10, "len": 0.7}
    line = {"color": values, "colorscale": _color_scale(), "width": 5, "colorbar": bar}
    return _scatter(
        _thinned(path.smoothed),
        "smoothed",
        mode="lines",
        line=line,
        showlegend=False,  # it would be black: `_legend_of_smoothed` has a colour
        customdata=np.round(_thinned(path.times), 3).tolist(),
        text=values,
        hovertemplate=f"after %{{customdata:.2f}} s<br>{path.label}: %{{text:.2f}}<br>"
        "x %{x:.3f}  y %{y:.3f}  z %{z:.3f} m<extra></extra>",
    )


def _legend_of_smoothed() -> dict[str, Any]:
    line = {"color": to_hex(mpl.colormaps[style.SEQUENTIAL](0.35)), "width": 5}
    nowhere = {axis: [None] for axis in "xyz"}
    return {"type": "scatter3d", "mode": "lines", "name": "smoothed", "line": line} | nowhere


def _color_scale() -> list[tuple[float, str]]:
    """The one of the other figures, as Plotly takes it."""
    at = np.linspace(0.0, 1.0, 17)
    return [(x, to_hex(mpl.colormaps[style.SEQUENTIAL](x))) for x in at.tolist()]


def _lines(ends: FloatArray) -> dict[str, Any]:
    """All in one trace: Plotly breaks it where a coordinate is null."""
    coordinates = {}
    for i, axis in enumerate("xyz"):
        both = np.round(ends[:, :, i], _DIGITS).tolist()
        coordinates[axis] = [value for pair in both for value in (*pair, None)]
    line = {"color": style.LINES, "width": 2}
    look = {"mode": "lines", "line": line, "hoverinfo": "skip", "name": "line map"}
    return {"type": "scatter3d"} | coordinates | look


def _thinned(values: FloatArray) -> FloatArray:
    step = max(1, -(-len(values) // _MAX_POSES))
    return values[::step]
