# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures inside the page: those of a run's `plots` folder, and drawn ones where it lacks some."""

import base64
import io
import re
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import read_tum
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.comparison_figures import error_figure
from ruledgraph.visualization.plots import result_figures
from ruledgraph.visualization.report.run import TRAJECTORIES, Run

_TITLES = {
    "trajectory": "Trajectory and line map, to one scale",
    "consistency": "Live errors in body axes, with the 3 sigma reported for each",
    "innovations": "Innovations by their covariance: 1 where the noise figures are right",
    "status": "Lines in view, reported position sigma and status",
    "states": "Velocity and IMU biases when each state was new, with 3 sigma",
    "ruled_surfaces": "Ruled surfaces: lines in image and time",
    "directrices": "Directrices and directions of the lines seen longest",
}
_NEEDED = ("trajectory", "status", "states")
_OVERLAY = re.compile(r"overlay_(\d{1,19})")
# Images of the camera are most of a page's size: they are stored as JPEG of this quality, and not
# wider than this, px.
_QUALITY, _WIDEST = 82, 900
_DPI = 110
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Picture:
    """An image in the page."""

    title: str
    source: str
    """A data URI."""
    narrow: bool = False
    """Whether it is one of the camera's images, of which several fit side by side."""


def pictures(run: Run, truth: GroundTruth | None) -> tuple[list[Picture], list[str]]:
    """All pictures of a run, and why some are missing."""
    notes: list[str] = []
    found = {}
    files = sorted((run.folder / "plots").glob("*.png"), key=_order)
    names = {path.stem for path in files}
    if not names.issuperset(_NEEDED):
        try:
            figures = result_figures(run.folder, truth)
        except RuledgraphError as error:
            notes.append(f"not drawn: {error}")
        else:
            for name, figure in figures.items():
                if name not in names:
                    found[name] = Picture(_TITLES[name], drawn(figure))
    for path in files:
        picture = _read(path, run.first_stamp)
        if picture is None:
            notes.append(f"{path.name}: cannot be read as a PNG")
        else:
            found[path.stem] = picture
    # Drawn and read ones, in the order of all.
    ordered = [found[name] for name in sorted(found, key=lambda name: _order(Path(name)))]
    errors = _error_picture(run, truth) if truth is not None else None
    return ([errors] if errors else []) + ordered, notes


def _error_picture(run: Run, truth: GroundTruth) -> Picture | None:
    estimates = {}
    for file, name in TRAJECTORIES.items():
        with suppress(RuledgraphError):  # `Run.not_evaluated` says so
            estimates[name] = read_tum(run.folder / f"{file}.tum")
    figure = error_figure(estimates, truth)
    return None if figure is None else Picture("Position error, aligned", drawn(figure))


def joint_errors(runs: Sequence[Run], truth: GroundTruth) -> Picture | None:
    """Smoothed position errors of several runs over time."""
    estimates = {}
    for number, run in enumerate(runs, start=1):
        with suppress(RuledgraphError):  # the table shows that it has none
            estimates[f"run {number}"] = read_tum(run.folder / "trajectory.tum")
    figure = error_figure(estimates, truth)
    if figure is None:
        return None
    return Picture("Position error of the smoothed trajectories, aligned", drawn(figure))


def _order(path: Path) -> tuple[int, str]:
    """Known ones first, the camera's images last."""
    known = list(_TITLES)
    if path.stem in known:
        return known.index(path.stem), path.name
    return len(known) + bool(_OVERLAY.fullmatch(path.stem)), path.name


def _read(path: Path, start: int | None) -> Picture | None:
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if not data.startswith(_PNG):
        return None
    overlay = _OVERLAY.fullmatch(path.stem)
    if overlay is None:
        return Picture(_TITLES.get(path.stem, path.stem), _uri("png", data))
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return None
    if (scale := _WIDEST / image.shape[1]) < 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    stamp = int(overlay[1])
    when = f"at {stamp} ns" if start is None else f"after {(stamp - start) * 1e-9:.1f} s"
    return Picture(f"Lines {when}", _uri("jpeg", encoded.tobytes()), narrow=True)


def drawn(figure: Figure) -> str:
    """A figure as a data URI."""
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of layouts too small for their titles
        figure.savefig(file, format="png", dpi=_DPI)
    return _uri("png", file.getvalue())


def _uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
