# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures from the files of a run."""

import numpy as np
import pytest

from ruledgraph.app.results import Results
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.visualization.plots import error_figure, result_figures


def circle(radius: float = 1.0, start: int = 0, bump: float = 0.0) -> Trajectory:
    t = np.linspace(0.0, 6.0, 61)
    positions = radius * np.stack([np.cos(t), np.sin(t), 0.2 * np.sin(2 * t)], axis=1)
    positions[30, 2] += bump
    stamps = start + np.rint(1e9 * t).astype(np.int64)
    return Trajectory(stamps, positions, np.tile([0.0, 0.0, 0.0, 1.0], (61, 1)))


def truth(start: int = 0) -> GroundTruth:
    known = circle(start=start)
    return GroundTruth(known.stamps, known.positions, known.quaternions)


@pytest.fixture
def run(tmp_path):
    with Results(tmp_path / "run", Config()):
        pass
    for name in ("trajectory.tum", "trajectory_live.tum"):
        (tmp_path / "run" / name).unlink()
        circle().write_tum(tmp_path / "run" / name)
    return tmp_path / "run"


def add_lines(run, ends):
    with (run / "lines.csv").open("a") as file:
        for number, (a, b) in enumerate(ends):
            numbers = [*a, *b, *[1e-6] * 12, 0.0, 6.0, 100]
            file.write(",".join(map(str, [number, *numbers])) + "\n")


def test_errors_over_time_in_mm():
    figure = error_figure({"one": circle(bump=0.02), "two": circle()}, truth())
    (axes,) = figure.axes
    one, two = axes.lines
    assert [line.get_label() for line in axes.lines] == ["one", "two"]
    assert np.argmax(one.get_ydata()) == 30
    assert one.get_ydata()[30] == pytest.approx(20.0, rel=0.1)
    assert one.get_xdata()[30] == pytest.approx(3.0)
    assert np.max(two.get_ydata()) == pytest.approx(0.0, abs=1e-6)


def test_no_errors_without_common_time():
    assert error_figure({"one": circle()}, truth(start=10**12)) is None
    assert error_figure({}, truth()) is None


def test_far_lines_do_not_hide_the_path(run):
    near = [((x, 0.0, -1.0), (x, 1.0, -1.0)) for x in np.linspace(-1.5, 1.5, 9)]
    add_lines(run, [*near, ((-14.0, 2.0, 0.0), (14.0, 2.0, 0.0))])
    figure = result_figures(run, truth())["trajectory"]
    for axes in figure.axes:
        low, high = axes.get_xlim()
        assert 2.0 < high - low < 8.0


def test_all_of_the_path_is_shown_without_lines(run):
    figure = result_figures(run, None)["trajectory"]
    low, high = figure.axes[0].get_xlim()
    assert low < -1.0
    assert high > 1.0


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("lines.csv", b"\xff"),
        ("lines.csv", b"line,x1\n1,2\n"),
        ("states.csv", b"stamp\nsoon\n"),
        ("trajectory.tum", b""),
    ],
)
def test_files_of_something_else_are_an_error(run, name, content):
    (run / name).write_bytes(content)
    with pytest.raises(RuledgraphError, match="run"):
        result_figures(run, None)
