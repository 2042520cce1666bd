# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A batch on one page: a table of comparison, box plots of the errors, every run, what failed."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ruledgraph.core import figure_style as style
from ruledgraph.core.text_file import write_whole
from ruledgraph.core.versions import version_text
from ruledgraph.visualization.report.page import environment
from ruledgraph.visualization.report.pictures import Picture, drawn

Row: TypeAlias = Mapping[str, Any]
"""Of one run, as in `table.csv`: numbers as texts, None where there are none."""

MEASURES = {
    "ate_live_mm": "ATE, live (mm)",
    "ate_smoothed_mm": "ATE, smoothed (mm)",
    "rpe_smoothed_mm_per_m": "RPE over 1 m, smoothed (mm)",
}
"""Column of the rows -> what the page calls it."""
# From this ratio of the largest to the least error on a logarithmic axis shows more.
_WIDE = 30.0


@dataclass(frozen=True, eq=False)
class Group:
    """The runs of one recording with one choice of settings; they differ in their seeds."""

    recording: str
    settings: str
    rows: tuple[Row, ...]

    @property
    def label(self) -> str:
        """In the figures, where there is little room."""
        name = Path(self.recording.partition("?")[0]).name
        return f"{name}\n{self.settings}" if self.settings else name

    @property
    def failed(self) -> int:
        """Runs without a result."""
        return sum(bool(row["error"]) for row in self.rows)

    @property
    def estimated(self) -> str:
        """Share of the frames."""
        counts = [(row["frames_estimated"], row["frames"]) for row in self.rows if row["frames"]]
        return (
            f"{100.0 * sum(c[0] for c in counts) / sum(c[1] for c in counts):.1f} %"
            if counts
            else "-"
        )

    def values(self, measure: str) -> list[float]:
        """Of the runs that have one."""
        return [float(row[measure]) for row in self.rows if row[measure] is not None]

    def shown(self, measure: str) -> str:
        """Median, and least and most."""
        values = self.values(measure)
        if not values:
            return "-"
        median = f"{statistics.median(values):.1f}"
        return median if len(values) == 1 else f"{median} ({min(values):.1f} to {max(values):.1f})"


def grouped(rows: Sequence[Row]) -> list[Group]:
    """Rows by recording and settings, in their order."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row["recording"], row["settings"]), []).append(row)
    return [Group(*key, tuple(group)) for key, group in found.items()]


def best(groups: Sequence[Group]) -> set[tuple[Group, str]]:
    """Of each recording with several choices of settings, and for each measure, the group with the
    least median, where no more of its runs failed than of any other.
    """
    found: set[tuple[Group, str]] = set()
    for recording in {group.recording for group in groups}:
        rivals = [group for group in groups if group.recording == recording]
        fewest = min(group.failed for group in rivals)
        sound = [group for group in rivals if group.failed == fewest]
        for measure in MEASURES:
            medians = [(statistics.median(v), g) for g in sound if (v := g.values(measure))]
            if len(rivals) > 1 and medians:
                found.add((min(medians, key=lambda pair: pair[0])[1], measure))
    return found


def write_batch_report(rows: Sequence[Row], path: Path) -> None:
    """Write the page, one file that needs no other, over an earlier one.

    Args:
        rows: of all runs so far.
        path: of the page; the runs' folders lie beside it.

    Raises:
        MachineError: when it cannot be written.
    """
    groups = grouped(rows)
    figure = box_figure(groups)
    text = (
        environment()
        .get_template("batch.html")
        .render(
            groups=groups,
            best=best(groups),
            rows=rows,
            measures=MEASURES,
            boxes=None if figure is None else Picture("Errors of all runs", drawn(figure)),
            failures=[row for row in rows if row["error"]],
            written=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
            version=version_text(),
        )
    )
    write_whole(path, text.encode(errors="replace"))


def box_figure(groups: Sequence[Group]) -> Figure | None:
    """Boxes from quartile to quartile, whiskers to least and most, and a point for each run: one
    panel for each measure, one row for each group. None without any error.
    """
    measures = [m for m in MEASURES if any(group.values(m) for group in groups)]
    if not measures:
        return None
    colours = {name: i for i, name in enumerate(dict.fromkeys(g.settings for g in groups))}
    with style.figure_style():
        figure = style.new_figure(13.0, 1.0 + 0.45 * len(groups))
        panels = figure.subplots(1, len(measures), sharey=True, squeeze=False)[0]
        for axes, measure in zip(panels, measures, strict=True):
            for i, group in enumerate(groups):
                values = group.values(measure)
                if not values:
                    continue
                colour = style.SERIES[colours[group.settings] % len(style.SERIES)]
                axes.boxplot(
                    [values],
                    positions=[i],
                    orientation="horizontal",
                    widths=0.55,
                    whis=(0, 100),
                    showfliers=False,
                    patch_artist=True,
                    boxprops={"facecolor": colour, "alpha": 0.3, "edgecolor": colour},
                    medianprops={"color": style.INK, "linewidth": 1.6},
                    whiskerprops={"color": colour},
                    capprops={"color": colour},
                )
                axes.plot(values, [i] * len(values), "o", ms=4, color=colour, mec="white", mew=0.5)
            everything = [value for group in groups for value in group.values(measure)]
            if min(everything) > 0.0 and max(everything) > _WIDE * min(everything):
                axes.set_xscale("log")
                axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axes.xaxis.set_major_formatter("{x:g}")
                axes.xaxis.set_minor_formatter(NullFormatter())
            else:
                axes.set_xlim(left=0.0)
            axes.set_xlabel(MEASURES[measure])
            for i, (above, below) in enumerate(pairwise(groups)):
                if above.recording != below.recording:
                    axes.axhline(i + 0.5, color=style.INK, linewidth=0.6, alpha=0.4)
        panels[0].set_yticks(range(len(groups)), [group.label for group in groups])
        panels[0].set_ylim(len(groups) - 0.4, -0.6)
    return figure
