# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The page of a batch."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from ruledgraph.visualization.report import write_batch_report
from ruledgraph.visualization.report.batch import best, box_figure, grouped


def row(recording: str, settings: str, live: float | None, **changes) -> dict:
    shown = None if live is None else f"{live:.2f}"
    return {
        "run": f"{recording}-{settings}-{live}".replace("/", "-"),
        "recording": recording,
        "settings": settings,
        "seed": None,
        "error": "" if live is not None else "it <broke> & died",
        "frames": None if live is None else 100,
        "frames_estimated": None if live is None else 90,
        "ate_live_mm": shown,
        "ate_smoothed_mm": shown,
        "rpe_smoothed_mm_per_m": None,
        "recoveries": 0,
        "warnings": 1,
        "real_time_factor": "2.00",
    } | changes


ROWS = [
    *(row("data/one.bag", "window.lag=1.2", live) for live in (3.0, 1.0, 2.0)),
    row("data/one.bag", "window.lag=2", 5.0),
    row("data/two.bag", "window.lag=1.2", None),
]


def test_groups_and_their_figures():
    first, second, third = grouped(ROWS)
    assert first.shown("ate_live_mm") == "2.0 (1.0 to 3.0)"
    assert second.shown("ate_live_mm") == "5.0"
    assert third.shown("ate_live_mm") == "-"
    assert (first.failed, third.failed) == (0, 1)
    assert (first.estimated, third.estimated) == ("90.0 %", "-")
    assert first.label == "one.bag\nwindow.lag=1.2"


def test_the_best_settings_of_a_recording_are_those_with_fewest_failures_and_least_median():
    failing = row("data/one.bag", "window.lag=3", None)
    groups = grouped([*ROWS, row("data/one.bag", "window.lag=3", 0.1), failing])
    assert {(group.recording, group.settings, m) for group, m in best(groups)} == {
        ("data/one.bag", "window.lag=1.2", "ate_live_mm"),
        ("data/one.bag", "window.lag=1.2", "ate_smoothed_mm"),
    }


def test_the_boxes_show_every_run():
    figure = box_figure(grouped(ROWS))
    assert figure is not None
    live, smoothed = figure.axes  # no run has the third measure
    points = [line for line in live.lines if line.get_marker() == "o"]
    assert [sorted(map(float, line.get_xdata())) for line in points] == [[1.0, 2.0, 3.0], [5.0]]
    medians = [line for line in live.lines if line.get_linewidth() == pytest.approx(1.6)]
    assert [float(line.get_xdata()[0]) for line in medians] == [2.0, 5.0]
    assert [label.get_text() for label in live.get_yticklabels()][2] == "two.bag\nwindow.lag=1.2"
    assert smoothed.get_xlabel() == "ATE, smoothed (mm)"
    plt.close("all")


@pytest.mark.parametrize(("largest", "scale"), [(20.0, "linear"), (2000.0, "log")])
def test_errors_far_apart_are_shown_on_a_logarithmic_axis(largest, scale):
    figure = box_figure(grouped([row("a", "", 1.0), row("b", "", largest)]))
    assert figure is not None
    assert figure.axes[0].get_xscale() == scale


def test_the_page_holds_all_and_escapes_what_others_wrote(tmp_path: Path):
    path = tmp_path / "report.html"
    path.write_text("an earlier one")
    write_batch_report(ROWS, path)
    text = path.read_text()
    assert "5 runs compared" in text
    assert "it &lt;broke&gt; &amp; died" in text
    assert "<broke>" not in text
    assert text.count("data:image/png;base64,") == 1
    assert len(re.findall(r'<a href="', text)) == 5
    # Nothing is fetched.
    assert not re.findall(r'(?:src|href)="(?:https?:)?//', text)
    rows = re.findall(r"<tr><th>data/one.bag</th>.*?</tr>", text, flags=re.DOTALL)
    assert len(rows) == 2
    assert "<strong>2.0 (1.0 to 3.0)</strong>" in rows[0]
    assert "<strong>" not in rows[1]


def test_a_batch_without_any_result(tmp_path: Path):
    write_batch_report([row("a", "", None)], tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "data:image" not in text
    write_batch_report([], tmp_path / "report.html")
    assert "0 runs compared" in (tmp_path / "report.html").read_text()
