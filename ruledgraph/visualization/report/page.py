# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The page: `page.html` filled in. Everything is escaped: names and warnings come from users."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.figure_style import status_color
from ruledgraph.core.versions import version_text
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.report.interactive import plotly_library, trajectory_json
from ruledgraph.visualization.report.pictures import Picture, joint_errors, pictures
from ruledgraph.visualization.report.run import ReportError, Run, own_truth, read_run
from ruledgraph.visualization.run_tables import read_run_tables
from ruledgraph.visualization.state_figures import status_pieces


@dataclass(frozen=True)
class _Entry:
    """A run's part of the page."""

    number: int
    run: Run
    pictures: list[Picture]
    notes: list[str]
    trajectory: str | None
    """A Plotly figure, JSON; None without poses."""
    pieces: list[tuple[float, float, str]]
    """Times from, to, s, and the status between them."""
    duration: float
    """Of the recording, s."""

    @property
    def overlay(self) -> Picture | None:
        """The camera's image in the middle of the run."""
        found = [picture for picture in self.pictures if picture.narrow]
        return found[len(found) // 2] if found else None


def write_report(
    folders: Sequence[Path],
    output: Path,
    truth: GroundTruth | None = None,
    *,
    force: bool = False,
) -> None:
    """Write one HTML file that needs nothing else.

    Args:
        folders: results of `ruledgraph smooth`, one or several.
        output: must not exist.
        truth: evaluate against this, not as the runs' own summaries say.
        force: overwrite `output`.

    Raises:
        ReportError: names the folder that holds no run, or why the file cannot be written.
    """
    runs = [read_run(folder, truth) for folder in folders]
    if output.exists() and not force:
        raise ReportError(f"{output}: exists already; overwrite it with --force")
    text = _page(runs, truth)
    try:
        # Names of files may hold bytes that are no UTF-8.
        with output.open("w" if force else "x", encoding="utf-8", errors="replace") as file:
            file.write(text)
    except OSError as error:
        raise ReportError(f"{output}: cannot be written: {error.strerror}") from None


def environment() -> Environment:
    """Of the pages' templates."""
    return Environment(
        loader=PackageLoader("ruledgraph.visualization.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _page(runs: Sequence[Run], truth: GroundTruth | None) -> str:
    templates = environment()
    templates.filters |= {
        "mm": lambda metres: _fixed(metres, 1e3, 1),
        "deg": lambda degrees: _fixed(degrees, 1.0, 2),
        "duration": _duration,
    }
    templates.filters["status_color"] = status_color
    entries = [_entry(i, run, truth) for i, run in enumerate(runs, start=1)]
    interactive = any(entry.trajectory for entry in entries)
    return templates.get_template("page.html").render(
        entries=entries,
        plotly=plotly_library() if interactive else None,
        settings=_different(runs),
        joint=joint_errors(runs, truth) if truth is not None and len(runs) > 1 else None,
        written=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
        version=version_text(),
    )


def _entry(number: int, run: Run, truth: GroundTruth | None) -> _Entry:
    truth = own_truth(run.folder) if truth is None else truth
    found, notes = pictures(run, truth)
    trajectory, pieces, duration = None, [], run.recording_s
    with suppress(RuledgraphError, KeyError, ValueError):  # `notes` say so
        tables = read_run_tables(run.folder)
        trajectory, pieces = trajectory_json(tables, truth), status_pieces(tables)
        duration = (tables.span[1] - tables.span[0]) * 1e-9
    return _Entry(number, run, found, notes, trajectory, pieces, max(duration, 1e-3))


def _different(runs: Sequence[Run]) -> dict[str, list[str]]:
    """The settings that are not the same in all runs: name -> value in each."""
    tables = [{setting.name: setting.value for setting in run.settings} for run in runs]
    names = dict.fromkeys(name for table in tables for name in table)
    values = {name: [table.get(name, "-") for table in tables] for name in names}
    return {name: each for name, each in values.items() if len(set(each)) > 1}


def _fixed(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def _duration(seconds: float) -> str:
    if not 60.0 <= seconds < 1e9:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
