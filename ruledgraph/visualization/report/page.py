# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The page: `page.html` filled in. Everything is escaped: names and warnings come from users."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from ruledgraph.core.versions import version_text
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.report.pictures import Picture, joint_errors, pictures
from ruledgraph.visualization.report.run import ReportError, Run, read_run


@dataclass(frozen=True)
class _Entry:
    """A run's part of the page."""

    number: int
    run: Run
    pictures: list[Picture]
    notes: list[str]


def write_report(folders: Sequence[Path], output: Path, truth: GroundTruth | None = None) -> None:
    """Write one HTML file that needs nothing else.

    Args:
        folders: results of `ruledgraph smooth`, one or several.
        output: must not exist.
        truth: evaluate against this, not as the runs' own summaries say.

    Raises:
        ReportError: names the folder that holds no run, or why the file cannot be written.
    """
    if output.exists():
        raise ReportError(f"{output}: exists already, choose another name")
    runs = [read_run(folder, truth) for folder in folders]
    text = _page(runs, truth)
    try:
        # Names of files may hold bytes that are no UTF-8.
        with output.open("x", encoding="utf-8", errors="replace") as file:
            file.write(text)
    except OSError as error:
        raise ReportError(f"{output}: cannot be written: {error.strerror}") from None


def _page(runs: Sequence[Run], truth: GroundTruth | None) -> str:
    environment = Environment(
        loader=PackageLoader("ruledgraph.visualization.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "mm": lambda metres: _fixed(metres, 1e3, 1),
        "deg": lambda degrees: _fixed(degrees, 1.0, 2),
        "duration": _duration,
    }
    entries = [_Entry(i, run, *pictures(run, truth)) for i, run in enumerate(runs, start=1)]
    return environment.get_template("page.html").render(
        entries=entries,
        settings=_different(runs),
        joint=joint_errors(runs, truth) if truth is not None and len(runs) > 1 else None,
        written=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
        version=version_text(),
    )


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
