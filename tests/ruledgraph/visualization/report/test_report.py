# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph report`: what the page says, that nothing in it is taken for HTML, and bad input."""

import base64
import gzip
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from html_page import Page
from ruledgraph.app.cli import main
from ruledgraph.app.run_input import RunInput
from ruledgraph.app.runner import run
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import Trajectory, read_tum
from ruledgraph.evaluation.ground_truth import GroundTruth
from small_simulation import small_simulation, small_stream

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("report")

NASTY = "<script>alert('1')</script>\"><img src=x onerror=alert(2)>&amp;"


def report(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["report", *map(str, arguments)])


@pytest.fixture(scope="module")
def truth() -> Trajectory:
    true = small_simulation().ground_truth
    rotations = np.tile([0.0, 0.0, 0.0, 1.0], (len(true.stamps), 1))
    return Trajectory(true.stamps, true.position, rotations)


@pytest.fixture(scope="module")
def finished(truth, tmp_path_factory) -> Path:
    stream, calibration = small_stream()
    output = tmp_path_factory.mktemp("results") / "first"
    true = GroundTruth(truth.stamps, truth.positions, truth.quaternions)
    given = RunInput(stream, calibration, true, {"recording": "small.bag"})
    run(given, load_config(None, ["window.lag=1.4"]), output)
    # With pictures there is nothing to draw, which takes most of the time.
    (output / "plots").mkdir()
    for name in ("trajectory", "consistency", "status", "states"):
        cv2.imwrite(str(output / "plots" / f"{name}.png"), np.full((40, 60, 3), 128, np.uint8))
    return output


def altered(finished: Path, folder: Path, **changes: object) -> Path:
    """A copy of a run with another summary."""
    shutil.copytree(finished, folder)
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | changes))
    return folder


def figures(found: Page) -> list[dict]:
    """The interactive ones of a page."""
    return [json.loads(script) for script in found.scripts if script.startswith('{"data"')]


def page(tmp_path, *arguments) -> Page:
    result = report(*arguments, "--output", tmp_path / "page.html")
    assert result.exit_code == 0, result.output
    assert result.output == f"{tmp_path / 'page.html'}\n"
    made = Page(tmp_path / "page.html")
    assert made.open == []
    return made


def test_a_page_of_one_run(finished, tmp_path):
    found = page(tmp_path, finished)
    summary = json.loads((finished / "summary.json").read_text())
    ate = 1e3 * summary["accuracy"]["trajectory"]["ate_rmse"]
    assert f"ATE, smoothed {ate:.1f} mm" in found.text
    assert f"frames estimated {summary['frames_estimated']} of {summary['frames']}" in found.text
    assert f"real-time factor {summary['real_time_factor']:.2f}" in found.text
    times = summary["stages"]["smoother"]
    row = f"smoother {times['count']} {times['mean_ms']:.1f} {times['p99_ms']:.1f}"
    assert f"{row} {times['max_ms']:.1f}" in found.text
    assert "recording small.bag" in found.text
    assert "lag 1.4 (default 4.0)" in found.text
    assert found.text.count("(default") == 1
    assert "Comparison" not in found.text


def test_the_page_needs_no_other_file(finished, tmp_path):
    found = page(tmp_path, finished)
    assert not {"link", "iframe", "object"} & {tag for tag, _ in found.elements}
    links = [a[k] for _, a in found.elements for k in ("src", "href", "srcset") if k in a]
    assert links
    assert all(link.startswith(("data:image/", "#")) for link in links)
    assert "@import" not in found.source
    assert "http" not in re.sub(r"data:image/[^\"]*", "", found.source)
    assert len(found.source) < 5_000_000


def test_plotly_lies_in_the_page(finished, tmp_path):
    found = page(tmp_path, finished)
    (packed,) = (s for s in found.scripts if re.fullmatch(r"[\w+/=]{1000,}", s.strip()))
    library = gzip.decompress(base64.b64decode(packed)).decode()
    assert "plotly.js v" in library[:2000]
    assert any("DecompressionStream" in script for script in found.scripts)


def test_the_trajectory_can_be_turned(finished, tmp_path):
    found = page(tmp_path, finished)
    (figure,) = figures(found)
    traces = {trace["name"]: trace for trace in figure["data"] if trace["x"] != [None]}
    assert list(traces) == ["line map", "truth", "live", "smoothed", "start", "end"]
    smoothed = read_tum(finished / "trajectory.tum")
    shown = np.array([traces["smoothed"][axis] for axis in "xyz"]).T
    np.testing.assert_allclose(shown[0], smoothed.positions[0], atol=1e-4)
    np.testing.assert_allclose(shown[-1], smoothed.positions[-1], atol=1e-4)
    errors = np.array(traces["smoothed"]["line"]["color"])
    summary = json.loads((finished / "summary.json").read_text())
    rmse = 1e3 * summary["accuracy"]["trajectory"]["ate_rmse"]
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(rmse, rel=0.02)
    assert traces["smoothed"]["customdata"][-1] == pytest.approx(4.4, abs=0.15)
    # Where the page is opened without ground truth the colours are times.
    (finished / "ground_truth.tum").rename(tmp_path / "kept.tum")
    try:
        found = page(tmp_path, finished, "--force")
    finally:
        (tmp_path / "kept.tum").rename(finished / "ground_truth.tum")
    (figure,) = figures(found)
    names = [trace["name"] for trace in figure["data"]]
    assert "truth" not in names
    bars = [t["line"]["colorbar"]["title"]["text"] for t in figure["data"] if "customdata" in t]
    assert bars == ["time (s)"]


def test_frames_without_an_estimate_are_seen(finished, tmp_path):
    found = page(tmp_path, finished)
    summary = json.loads((finished / "summary.json").read_text())
    missing = summary["frames"] - summary["frames_estimated"]
    assert missing > 0
    assert f"{missing} without an estimate" in found.text
    assert found.text.count(f"without estimate: {missing} frames") == 1
    strips = [a for tag, a in found.elements if tag == "rect" and a.get("fill", "")]
    assert any(a["fill"].startswith("url(#missing") and float(a["width"]) > 5 for a in strips)
    # Nothing is drawn twice or left out: without overlaps the strip is as long as the recording.
    assert sum(float(a["width"]) for a in strips) == pytest.approx(1000.0, abs=15.0)


def test_the_first_screen_comes_first_and_settings_last(finished, tmp_path):
    text = page(tmp_path, finished).text
    order = ["ATE, smoothed", "without estimate", "Accuracy", "Pictures", "Time of the stages"]
    places = [text.index(part) for part in [*order, "Settings in effect"]]
    assert places == sorted(places)


def test_pictures_are_drawn_where_there_are_none(finished, tmp_path):
    folder = altered(finished, tmp_path / "run")
    shutil.rmtree(folder / "plots")
    found = page(tmp_path, folder)
    titles = [title for title, _ in found.images()]
    assert titles[0] == "Position error, aligned"
    assert titles[1] == "Trajectory and line map, to one scale"
    assert len(titles) == 6
    for _, source in found.images():
        data = base64.b64decode(source.removeprefix("data:image/png;base64,"), validate=True)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image.std() > 5.0
    assert not (folder / "plots").exists()


def test_pictures_of_the_run_are_taken_as_they_are(finished, tmp_path):
    folder = altered(finished, tmp_path / "run")
    image = np.full((40, 60, 3), 128, np.uint8)
    stamp = int(small_stream()[0][0].stamp) + 2 * 10**9
    for name in ("trajectory", f"overlay_{stamp}", "my <own> & b"):
        cv2.imwrite(str(folder / "plots" / f"{name}.png"), image)
    (folder / "plots" / "broken.png").write_bytes(b"no picture")
    found = page(tmp_path, folder)
    images = dict(found.images())
    kept = base64.b64encode((folder / "plots" / "trajectory.png").read_bytes()).decode()
    assert images["Trajectory and line map, to one scale"] == f"data:image/png;base64,{kept}"
    assert "my <own> & b" in images
    overlays = [title for title in images if re.fullmatch(r"Lines after \d\.\d s", title)]
    assert len(overlays) == 1
    assert images[overlays[0]].startswith("data:image/jpeg;base64,")
    assert "broken.png: cannot be read as a PNG" in found.text
    assert len(images) == 7  # the position error is drawn, the other three are the run's


def test_nothing_a_run_says_becomes_html(finished, tmp_path):
    folder = altered(
        finished,
        tmp_path / "<b>run & 1",
        ended=NASTY,
        warnings=[NASTY],
        recoveries=[NASTY],
        status={NASTY: 3, "still": 4},
        stages={NASTY: {"count": 1, "mean_ms": 1.0, "p99_ms": 1.0, "max_ms": 2.0}},
        inputs={NASTY: NASTY},
        accuracy={"trajectory": {"error": NASTY}},
    )
    (folder / "config.yaml").write_text(NASTY)
    picture = "quote\" onload='x'.png"
    cv2.imwrite(str(folder / "plots" / picture), np.zeros((4, 4), np.uint8))
    found = page(tmp_path, folder, finished)
    assert not any("alert" in script for script in found.scripts)
    assert len(found.scripts) == 4  # two figures, Plotly, and what draws them
    assert not {name for _, a in found.elements for name in a if name.startswith("on")}
    assert all(a["src"].startswith("data:") for tag, a in found.elements if tag == "img")
    assert found.text.count(NASTY) >= 8
    assert "<b>run & 1" in found.text
    assert picture.removesuffix(".png") in dict(found.images())


def test_names_that_are_no_unicode_are_written_somehow(finished, tmp_path):
    folder = altered(finished, tmp_path / "run\udcff", warnings=["\ud800 odd"])
    assert "? odd" in page(tmp_path, folder).text


def test_several_runs_are_compared(finished, truth, tmp_path):
    other = altered(finished, tmp_path / "second", recoveries=["once"], warnings_left_off=3)
    text = (finished / "config.yaml").read_text().replace("lag: 1.4", "lag: 2.0")
    (other / "config.yaml").write_text(text)
    truth.write_tum(tmp_path / "truth.tum")
    (other / "trajectory.tum").unlink()
    truth.write_tum(other / "trajectory.tum")  # a perfect one
    found = page(tmp_path, finished, other, "--ground-truth", tmp_path / "truth.tum")
    assert "2 runs compared" in found.text
    assert re.search(r"2\. second \d+\.\d 0\.0 ", found.text)
    assert "window.lag 1.4 2.0" in found.text
    assert "lines.cauchy_scale_px" not in found.text
    titles = [title for title, _ in found.images()]
    assert titles[0] == "Position error of the smoothed trajectories, aligned"
    assert titles.count("Position error, aligned") == 2
    ids = {a["id"] for tag, a in found.elements if "id" in a and tag == "section"}
    assert {a["href"] for tag, a in found.elements if tag == "a"} == {f"#{i}" for i in ids}


def test_a_run_without_ground_truth_or_poses(finished, tmp_path):
    folder = altered(finished, tmp_path / "none", frames_estimated=0, status={}, stages={})
    summary = json.loads((folder / "summary.json").read_text())
    for key in ("accuracy", "inputs", "versions", "machine", "solver"):
        del summary[key]
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "trajectory.tum").write_text("")
    (folder / "ground_truth.tum").unlink()
    shutil.rmtree(folder / "plots")
    found = page(tmp_path, folder)
    assert "ATE" not in found.text
    assert "not drawn: " in found.text
    assert found.images() == []


def test_an_existing_page_is_kept_without_force(finished, tmp_path):
    path = tmp_path / "mine.html"
    path.write_text("mine")
    result = report(finished, "--output", path)
    assert result.exit_code == 2
    assert result.output.endswith("mine.html: exists already; overwrite it with --force\n")
    assert path.read_text() == "mine"
    assert report(finished, "--output", path, "--force").exit_code == 0
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_the_page_lies_in_the_folder_of_its_run(finished, tmp_path):
    folder = altered(finished, tmp_path / "run")
    result = report(folder)
    assert result.exit_code == 0, result.output
    assert result.output == f"{folder / 'report.html'}\n"
    assert (folder / "report.html").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no results of a run that has ended: summary.json: No such file"),
        ("{", "summary.json: is not JSON"),
        ("[]", "summary.json: is no summary of a run"),
        ("{}", "summary.json: is no summary of a run: lacks 'ended'"),
        ('{"accuracy": 3}', "summary.json: is no summary of a run"),
        ("[" * 100_000, "summary.json: is not JSON"),
    ],
)
def test_a_folder_without_a_run_is_one_line(tmp_path, content, message):
    if content is not None:
        (tmp_path / "summary.json").write_text(content)
    result = report(tmp_path, "--output", tmp_path / "page.html")
    assert result.exit_code == 2
    assert message in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "page.html").exists()


def test_a_folder_of_runs_and_one_that_is_not_there_are_said(finished, tmp_path):
    (tmp_path / "page.html").touch()
    result = report(finished.parent, "--output", tmp_path / "page.html")
    assert f"name them: ruledgraph report {finished.parent}/*/" in result.output
    result = report(tmp_path / "nothing")
    assert result.output == f"ruledgraph: {tmp_path / 'nothing'} does not exist\n"


@pytest.mark.parametrize(
    "change",
    [
        {"frames": "many"},
        {"warnings": "one"},
        {"stages": {"search": {"count": 3}}},
        {"status": ["still"]},
        {"wall_s": None},
        {"accuracy": {"trajectory": {"poses": 3}}},
    ],
)
def test_a_summary_of_something_else_is_one_line(finished, tmp_path, change):
    result = report(altered(finished, tmp_path / "odd", **change), "--output", tmp_path / "x.html")
    assert result.exit_code == 2
    assert "odd/summary.json: is no summary of a run" in result.output
    assert len(result.output.strip().splitlines()) == 1


def test_a_page_that_cannot_be_written_is_one_line(finished, tmp_path):
    result = report(finished, "--output", tmp_path / "nowhere" / "page.html")
    assert result.exit_code == 2
    assert "page.html: cannot be written: No such file" in result.output
