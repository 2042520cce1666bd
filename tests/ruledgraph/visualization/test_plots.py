# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the files of a run show what is in them."""

import json

import cv2
import gtsam
import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D

from ruledgraph.app.results import Results
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame
from ruledgraph.core.trajectory import Trajectory, seconds
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry
from ruledgraph.visualization.comparison_figures import error_figure
from ruledgraph.visualization.plots import PlotRecorder, result_figures
from ruledgraph.visualization.run_tables import read_run_tables
from ruledgraph.visualization.state_figures import live_errors, status_pieces
from ruledgraph.visualization.surface_figures import ruled_surface_figure
from small_simulation import SMALL, small_stream

STEP = 10**8
STATE_SIGMA = 0.01


def circle(radius: float = 1.0, start: int = 0, bump: float = 0.0) -> Trajectory:
    t = np.linspace(0.0, 6.0, 61)
    positions = radius * np.stack([np.cos(t), np.sin(t), 0.2 * np.sin(2 * t)], axis=1)
    positions[30, 2] += bump
    stamps = start + np.rint(1e9 * t).astype(np.int64)
    return Trajectory(stamps, positions, np.tile([0.0, 0.0, 0.0, 1.0], (61, 1)))


def truth(start: int = 0) -> GroundTruth:
    known = circle(start=start)
    return GroundTruth(known.stamps, known.positions, known.quaternions)


def write_run(folder, trajectory, statuses=None):
    """A run with a state at every second pose."""
    with Results(folder, Config()):
        pass
    for name in ("trajectory.tum", "trajectory_live.tum"):
        (folder / name).unlink()
        trajectory.write_tum(folder / name)
    header = (folder / "states.csv").read_text().strip().split(",")
    with (folder / "states.csv").open("a") as file:
        for k, stamp in enumerate(trajectory.stamps[::2]):
            row = dict.fromkeys(header, STATE_SIGMA)
            row |= {"stamp": seconds(stamp), "status": statuses[k] if statuses else "tracking"}
            file.write(",".join(str(row[name]) for name in header) + "\n")
    return folder


@pytest.fixture
def run(tmp_path):
    return write_run(tmp_path / "run", circle())


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


def views(figure):
    return {axes.get_title(loc="left"): axes for axes in figure.axes if axes.get_title(loc="left")}


def test_views_have_one_scale_and_show_path_and_lines(run):
    near = [((x, 0.0, -1.0), (x, 1.0, -1.0)) for x in np.linspace(-1.5, 1.5, 9)]
    far = ((-400.0, 2.0, 0.0), (400.0, 2.0, 0.0))
    add_lines(run, [*near, far])
    figure = result_figures(run, truth())["trajectory"]
    shown = views(figure)
    assert {"top", "side", "front"} <= set(shown)
    scales = []
    for name, pair in (("top", (0, 1)), ("side", (1, 2)), ("front", (0, 2))):
        axes = shown[name]
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        path = circle().positions[:, pair]
        assert (path > low).all()
        assert (path < high).all()
        # The far line does not make the path too small to be seen.
        assert (high - low).max() < 40.0
        box = axes.get_position()
        size = figure.get_size_inches() * (box.width, box.height)
        scales += (size / (high - low)).tolist()
    assert max(scales) == pytest.approx(min(scales), rel=0.01)
    ends = np.concatenate([c.get_segments() for c in shown["top"].collections[:1]])
    assert len(ends) == len(near) + 1


def test_the_colors_of_the_path_are_its_errors(tmp_path):
    run = write_run(tmp_path / "run", circle(bump=0.02))
    for known, label in ((truth(), "position error (mm)"), (None, "time (s)")):
        figure = result_figures(run, known)["trajectory"]
        colored = views(figure)["top"].collections[-1].get_array()
        assert any(label in text.get_text() for axes in figure.axes for text in axes.texts)
        if known is None:
            np.testing.assert_allclose(colored, np.arange(60) * 0.1, atol=1e-6)
        else:
            assert np.argmax(colored) == 30
            assert colored.max() == pytest.approx(20.0, rel=0.1)


def test_all_of_the_path_is_shown_without_lines(run):
    figure = result_figures(run, None)["trajectory"]
    low, high = figure.axes[0].get_xlim()
    assert low < -1.0
    assert high > 1.0


def test_errors_count_from_the_first_pose_and_are_in_body_axes(tmp_path):
    """An offset in the world's z is one along y of a body that is turned so."""
    turned = gtsam.Rot3.Rx(np.pi / 2)
    poses = [gtsam.Pose3(turned, p) for p in circle(bump=0.02).positions]
    estimate = Trajectory.from_poses(circle().stamps, poses)
    yaw = gtsam.Pose3(gtsam.Rot3.Yaw(1.0), np.array([3.0, -1.0, 2.0]))
    true = Trajectory.from_poses(
        circle().stamps, [yaw.compose(gtsam.Pose3(turned, p)) for p in circle().positions]
    )
    run = read_run_tables(write_run(tmp_path / "run", estimate))
    at, errors = live_errors(run, GroundTruth(true.stamps, true.positions, true.quaternions))
    np.testing.assert_array_equal(at, np.arange(31))
    bumped = np.zeros((31, 6))
    bumped[15] = [0.0, 0.0, 0.0, 0.0, -0.02, 0.0]
    np.testing.assert_allclose(errors, bumped, atol=1e-9)


def set_column(run, name, values):
    """Overwrite a column of `states.csv`."""
    text = (run / "states.csv").read_text().splitlines()
    column = text[0].split(",").index(name)
    rows = [row.split(",") for row in text[1:]]
    for row, value in zip(rows, values, strict=True):
        row[column] = value
    (run / "states.csv").write_text("\n".join([text[0], *map(",".join, rows)]) + "\n")


def test_innovations_are_shown_over_their_degrees_of_freedom(tmp_path):
    run = write_run(tmp_path / "run", circle())
    # Of 31 states two have none and one is far beyond what 6 degrees of freedom explain.
    set_column(run, "nis", ["", "", "60", *["6"] * 28])
    set_column(run, "nis_dof", ["", "", *["6"] * 29])
    (axes,) = result_figures(run, None)["innovations"].axes
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [10.0, *[1.0] * 28])
    assert axes.lines[1].get_ydata()[0] == pytest.approx(1.9)  # (10 + 9) / 10
    assert axes.get_title(loc="right") == "mean 1.31 (1 expected), 97 % within bounds"


def test_without_innovations_there_is_no_figure_of_them(tmp_path):
    run = write_run(tmp_path / "run", circle())
    set_column(run, "nis", [""] * 31)
    assert "innovations" not in result_figures(run, None)


def test_each_axis_has_its_own_band(tmp_path):
    run = write_run(tmp_path / "run", circle())
    set_column(run, "sigma_position_y", ["0.05"] * 31)
    figure = result_figures(run, truth())["consistency"]
    widths = [axes.lines[1].get_ydata()[5] for axes in figure.axes[:3]]
    assert widths == pytest.approx([30.0, 150.0, 30.0])
    low, high = figure.axes[0].get_ylim()
    assert 150.0 < high == -low < 200.0
    shares = [axes.get_title(loc="right") for axes in figure.axes]
    assert shares == ["100 % within 3 sigma"] * 6


def test_directrices_are_drawn_on_request(run):
    add_lines(run, [((0.0, 0.0, -1.0), (0.0, 1.0, -1.0))])
    assert "directrices" not in result_figures(run, None)
    figure = result_figures(run, None, directrices=True)["directrices"]
    # A line along y: its closest point is -x along x, its direction y.
    np.testing.assert_allclose(
        figure.axes[0].lines[0].get_ydata(), -circle().positions[:, 0], atol=1e-12
    )
    np.testing.assert_allclose(figure.axes[4].lines[0].get_ydata(), 1.0)


def test_status_over_time_shows_frames_without_estimate(tmp_path):
    whole = circle(start=10**9)
    kept = np.r_[0:31, 41:61]
    parts = Trajectory(whole.stamps[kept], whole.positions[kept], whole.quaternions[kept])
    run = write_run(tmp_path / "run", parts, ["still"] * 6 + ["tracking"] * 20)
    span = {"first_frame_ns": 0, "last_frame_ns": 8 * 10**9}
    (run / "summary.json").write_text(json.dumps(span))
    pieces = status_pieces(read_run_tables(run))
    rounded = [(round(a, 6), round(b, 6), name) for a, b, name in pieces]
    assert rounded == [
        (1.0, 2.0, "still"),
        (2.0, 7.0, "tracking"),
        (0.0, 1.0, "without estimate"),
        (4.0, 5.1, "without estimate"),
        (7.0, 8.0, "without estimate"),
    ]


def test_nothing_is_drawn_across_a_gap_without_estimates(tmp_path):
    """Between 3 and 5 s of 6 there is none."""
    whole = circle()
    kept = np.r_[0:31, 50:61]
    parts = Trajectory(whole.stamps[kept], whole.positions[kept], whole.quaternions[kept])
    run = write_run(tmp_path / "run", parts)
    figures = result_figures(run, truth())
    curves = [
        axes.lines[-1 if name == "states" else 0]
        for name in ("status", "consistency", "states")
        for axes in figures[name].axes
        if axes.lines
    ]
    assert len(curves) == 2 + 6 + 9
    for curve in curves:
        times = curve.get_xdata()
        across = (times[:-1] <= 3.001) & (times[1:] >= 4.9)
        ends = np.isnan(curve.get_ydata())
        assert (across <= (ends[:-1] | ends[1:])).all()
        assert np.isfinite(curve.get_ydata()).sum() >= 20
    shown = views(figures["trajectory"])["top"].lines
    steps = [np.linalg.norm(np.diff(curve.get_xydata(), axis=0), axis=1) for curve in shown]
    assert all(np.nanmax(lengths, initial=0.0) < 0.3 for lengths in steps)


def test_states_name_their_frames(run):
    titles = [axes.get_title(loc="left") for axes in result_figures(run, None)["states"].axes]
    assert titles[0] == "velocity x, world"
    assert titles[3] == "gyroscope bias x, body"


def test_the_legend_shows_the_colors_of_the_path(run):
    figure = result_figures(run, truth())["trajectory"]
    (legend,) = figure.legends
    drawn = {to_rgba(line.get_color()) for line in legend.findobj(Line2D)}
    path = views(figure)["top"].collections[-1]
    assert {to_rgba(path.cmap(share)) for share in (0.0, 1.0)} <= drawn


def test_ruled_surfaces_are_of_lines_apart_from_each_other():
    def seen(u, count=20):
        return [(0.1 * k, np.array([[u, 10.0], [u, 200.0]])) for k in range(count)]

    surfaces = {n: seen(100.0 + 0.1 * n) for n in range(10)} | {50: seen(300.0), 51: seen(10.0, 2)}
    figure = ruled_surface_figure(surfaces, SMALL.camera)
    (axes,) = figure.axes
    numbers = [int(text.get_text()) for text in axes.texts]
    assert len(numbers) == len(set(numbers)) == 8
    assert 50 in numbers[:2]
    assert 51 not in numbers
    assert any("ruled surface" in text.get_text() for text in figure.texts)
    assert not any(drawn.get_clip_on() for drawn in (*axes.lines, *axes.collections))


def test_a_run_leaves_overlays_and_figures(tmp_path):
    stream, calibration = small_stream(moving=True)
    odometry, pictures = Odometry(calibration), PlotRecorder(calibration.camera)
    for measurement in stream:
        odometry.add(measurement)
        if isinstance(measurement, Frame):
            pictures.watch(odometry, measurement)
    pictures.draw(write_run(tmp_path / "run", circle()), None)
    names = {path.stem for path in (tmp_path / "run" / "plots").iterdir()}
    assert {"trajectory", "status", "states", "ruled_surfaces"} <= names
    overlays = sorted((tmp_path / "run" / "plots").glob("overlay_*.png"))
    assert len(overlays) >= 3
    stamps = {m.stamp for m in stream if isinstance(m, Frame)}
    for path in overlays:
        assert int(path.stem.removeprefix("overlay_")) in stamps
        image = cv2.imread(str(path)).astype(int)
        assert np.mean(np.ptp(image, axis=2) > 100) > 0.002


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
