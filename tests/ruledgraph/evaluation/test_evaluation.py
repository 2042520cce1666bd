# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluation: the same digits as evo's programs, and the paper's measures on known errors."""

import json
import re
import subprocess
import sys
from pathlib import Path

import gtsam
import numpy as np
import pytest
from click.testing import CliRunner, Result
from evo.tools import file_interface

from ruledgraph.app.cli import main
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import (
    EvaluationError,
    axis_differences,
    compare,
    line_distances,
    point_line_distances,
)
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.evaluation.sources import read_marker_points, read_poses
from ruledgraph.recording import GroundTruthPose, write_recording
from ruledgraph.simulation import simulate
from ruledgraph.visualization.comparison_figures import evaluation_figures

PROGRAMS = Path(sys.executable).parent
STAMPS = 1_700_000_000_000_000_000 + np.arange(0, 20_000_000_000, 50_000_000)


def poses(stamps) -> list[gtsam.Pose3]:
    t = (stamps - STAMPS[0]) * 1e-9
    return [
        gtsam.Pose3(
            gtsam.Rot3.RzRyRx(0.3 * np.sin(x), 0.2 * np.cos(2 * x), 0.5 * x),
            np.array([2.0 * np.cos(0.6 * x), 3.0 * np.sin(0.4 * x), 0.5 * np.sin(x)]),
        )
        for x in t
    ]


def reference() -> Trajectory:
    return Trajectory.from_poses(STAMPS, poses(STAMPS))


def estimate() -> Trajectory:
    """Noisy, at another rate, in another frame and of another scale."""
    rng = np.random.default_rng(1)
    stamps = STAMPS[0] + np.arange(100_000_000, 19_000_000_000, 33_333_333)
    moved = gtsam.Pose3(gtsam.Rot3.Yaw(0.7), np.array([1.0, -2.0, 0.3]))
    noisy = []
    for pose in poses(stamps):
        noise = gtsam.Pose3.Expmap(rng.normal(0.0, 0.01, 6))
        scaled = gtsam.Pose3(pose.rotation(), 1.02 * pose.translation())
        noisy.append(moved.compose(scaled).compose(noise))
    return Trajectory.from_poses(stamps, noisy)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("trajectories")
    reference().write_tum(folder / "reference.tum")
    run = folder / "run1"
    run.mkdir()
    estimate().write_tum(run / "trajectory.tum")
    return run, folder / "reference.tum"


def evaluate(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["evaluate", *map(str, arguments)])


def printed(program: str, *arguments: object) -> dict[str, str]:
    """The figures a program of evo's prints, as text."""
    command = [PROGRAMS / program, "tum", *map(str, arguments)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return dict(re.findall(r"^\s+(max|mean|median|min|rmse|sse|std)\t([\d.]+)$", text, re.M))


@pytest.mark.parametrize(
    ("align", "flags"),
    [("none", ()), ("origin", ("--align_origin",)), ("se3", ("-a",)), ("sim3", ("-a", "-s"))],
)
def test_ate_is_what_evo_ape_prints(files, align, flags):
    run, truth = files
    result = evaluate(run, truth, "--align", align, "--json")
    assert result.exit_code == 0, result.output
    errors = json.loads(result.output)["errors"]
    relations = {"ate_translation": "trans_part"}
    if align == "se3":
        relations["ate_rotation"] = "angle_deg"
    for name, relation in relations.items():
        theirs = printed("evo_ape", truth, run / "trajectory.tum", "-r", relation, *flags)
        assert len(theirs) == 7
        assert {key: f"{errors[name][key]:.6f}" for key in theirs} == theirs


def test_rpe_is_what_evo_rpe_prints(files):
    run, truth = files
    result = evaluate(run, truth, "--json", "--length", 1, "--length", 5)
    errors = json.loads(result.output)["errors"]
    for length, part, relation in (
        (1, "translation", "trans_part"),
        (5, "translation", "trans_part"),
        (5, "rotation", "angle_deg"),
    ):
        theirs = printed(
            *("evo_rpe", truth, run / "trajectory.tum", "-a", "-r", relation),
            *("--delta", length, "--delta_unit", "m", "--all_pairs"),
        )
        found = errors[f"rpe_{part}_{length}m"]
        assert {key: f"{found[key]:.6f}" for key in theirs} == theirs


def test_evo_res_reads_what_is_saved(files, tmp_path):
    run, truth = files
    result = evaluate(run, truth, "--save", tmp_path / "evo", "--length", 2)
    assert result.exit_code == 0, result.output
    saved = sorted((tmp_path / "evo").iterdir())
    assert [path.name for path in saved] == [
        f"{name}.zip"
        for name in ("ate_rotation", "ate_translation", "rpe_rotation_2m", "rpe_translation_2m")
    ]
    command = [PROGRAMS / "evo_res", saved[1], "--use_filenames"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    loaded = file_interface.load_res_file(saved[1])
    assert "SE(3) Umeyama" in loaded.info["title"]
    assert f"{loaded.stats['rmse']:.4f}" in text


def test_plots_are_drawn(files, tmp_path):
    run, truth = files
    result = evaluate(run, truth, "--plots", tmp_path / "plots", "--length", 100)
    assert result.exit_code == 0, result.output
    names = {path.name for path in (tmp_path / "plots").iterdir()}
    assert names == {"trajectories.png", "ate.png"}  # RPE needs a longer path
    assert "note: no RPE over 100 m" in result.output
    again = evaluate(run, truth, "--plots", tmp_path / "plots")
    assert again.exit_code == 2
    assert "plots: is not empty; name another folder" in again.output


def test_several_estimates_are_compared_and_drawn_together(files, tmp_path):
    run, truth = files
    folder = tmp_path / "out"
    more = ("--length", 1, "--length", 2, "--plots", folder / "plots", "--save", folder / "evo")
    result = evaluate(run, truth, truth, *more)
    assert result.exit_code == 0, result.output
    names = [Path(run).stem, Path(truth).stem]
    assert [line[:-1] for line in result.output.splitlines() if line[:-1] in names] == names
    assert {path.name for path in (folder / "plots").iterdir()} == {
        "trajectories.png",
        "ate.png",
        "rpe.png",
    }
    assert {path.name for path in (folder / "evo").iterdir()} == set(names)
    found = json.loads(evaluate(run, truth, truth, "--json").output)
    assert list(found) == names
    alone = json.loads(evaluate(run, truth, "--json").output)
    assert found[names[0]] == alone
    assert found[names[1]]["errors"]["ate_translation"]["rmse"] == pytest.approx(0.0, abs=1e-9)


def test_figures_of_several_estimates_hold_each_ones_errors(files):
    run, truth = files
    known = read_poses(str(truth))
    found = {}
    for name, path in (("ours", run), ("perfect", truth)):
        poses = read_poses(str(path))
        trajectory = Trajectory(poses.stamps, poses.positions, poses.quaternions)
        found[name] = compare(trajectory, known, lengths=[1.0, 2.0])
    figures = evaluation_figures(found)
    assert list(figures) == ["trajectories", "ate", "rpe"]
    translation = figures["ate"].axes[0]
    for line, one in zip(translation.lines, found.values(), strict=True):
        rmse = np.sqrt(np.mean(np.square(line.get_ydata())))
        assert rmse == pytest.approx(1e3 * one.errors["ate_translation"].rmse, abs=1e-6)
    labels = figures["trajectories"].axes[0].get_legend_handles_labels()[1]
    assert labels == ["reference", "ours", "perfect", "start"]
    boxes = figures["rpe"].axes[0].patches
    assert len(boxes) == 4


def test_position_and_yaw_are_aligned_and_no_more():
    true = reference()
    tilt = gtsam.Pose3(gtsam.Rot3.RzRyRx(0.1, 0.0, 0.0), np.zeros(3))
    yawed = gtsam.Pose3(gtsam.Rot3.Yaw(2.0), np.array([5.0, 1.0, -2.0]))
    truth = GroundTruth(true.stamps, true.positions, true.quaternions)

    def ate(move: gtsam.Pose3) -> float:
        moved = Trajectory.from_poses(true.stamps, [move.compose(p) for p in true.poses()])
        return compare(moved, truth, align="posyaw").errors["ate_rotation"].mean

    assert ate(yawed) < 1e-5
    assert ate(yawed.compose(tilt)) == pytest.approx(np.degrees(0.1), rel=1e-3)


def test_what_was_compared_is_reported(files):
    result = evaluate(*files)
    assert result.exit_code == 0
    assert re.search(
        r"^\d+ of 568 poses compared, with 400 of the reference: stamps at most 10 ms",
        result.output,
    )
    assert re.search(r"100.0 % of the estimate's duration", result.output)
    assert "RPE translation 10m (m)" in result.output


def test_differences_by_axis_are_those_of_the_initial_camera_frame():
    """The body's z axis is the camera's -y: a drift along it shows there."""
    true = reference()
    first = true.poses()[0]
    drift = np.linspace(0.0, 0.2, len(true))
    drifted = [
        gtsam.Pose3(p.rotation(), p.translation() + first.rotation().rotate(np.array([0, 0, d])))
        for p, d in zip(true.poses(), drift, strict=True)
    ]
    elsewhere = gtsam.Pose3(gtsam.Rot3.RzRyRx(1.0, 0.4, -0.3), np.array([3.0, 2.0, 1.0]))
    moved = Trajectory.from_poses(true.stamps, [elsewhere.compose(p) for p in drifted])
    truth = GroundTruth(true.stamps, true.positions, true.quaternions)
    mounting = gtsam.Rot3(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
    found = axis_differences(moved, truth, gtsam.Pose3(mounting, np.array([0.1, 0.0, 0.0])))
    np.testing.assert_allclose(found.mean, [0.0, -0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.std, [0.0, drift.std(), 0.0], atol=1e-9)


def test_markers_are_measured_to_the_unbounded_line():
    ends = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    points = np.array([[5.0, 3.0, 4.0], [-2.0, 0.0, 1.0]])
    np.testing.assert_allclose(point_line_distances(points, ends), [5.0, 1.0])
    shifted = np.eye(4)
    shifted[1, 3] = 0.1
    markers = {"a/1": points[0] * [1, 0, 0], "a/2": points[1] * [1, 0, 0], "b/1": points[0]}
    lines = np.stack([ends + np.array([0.0, 9.0, 0.0]), ends])
    a, b = line_distances(markers, lines, shifted)
    assert (a.name, a.markers, a.line) == ("a", 2, 1)
    assert (a.mean, a.std) == pytest.approx((0.1, 0.0))
    assert b.mean == pytest.approx(np.hypot(2.9, 4.0))
    with pytest.raises(EvaluationError, match="no line was estimated"):
        line_distances(markers, np.empty((0, 2, 3)), np.eye(4))


def test_lines_of_a_run_are_compared_with_markers(files, tmp_path):
    run, truth = files
    columns = "line,x1,y1,z1,x2,y2,z2"
    (run / "lines.csv").write_text(f"{columns}\n0,0,0,0,0,0,1\n")
    markers = tmp_path / "markers.csv"
    markers.write_text("name,x,y,z\npole/low,0,0,0.5\npole/high,0,0,2\n")
    result = evaluate(run, truth, "--align", "none", "--markers", markers)
    (run / "lines.csv").unlink()
    assert "pole: 2 markers 0.0000 ± 0.0000 m from the nearest line" in result.output


def test_topics_are_read(tmp_path, files):
    simulation = simulate("square", "free", rate=10.0, duration=1.0)
    true = reference()
    rows = zip(true.stamps.tolist(), true.positions, true.quaternions, strict=True)
    bag = tmp_path / "truth.bag"
    write_recording(
        simulation.stream(),
        bag,
        "rosbag1",
        calibration=simulation.calibration,
        ground_truth=(GroundTruthPose(*row) for row in rows),
    )
    wrong = evaluate(files[0], f"{bag}:/nothing")
    assert wrong.exit_code == 2
    topic = re.search(r"topics with ground truth: ([^\s,]+)", wrong.output)[1]
    result = evaluate(files[0], f"{bag}:{topic}", "--json")
    assert result.exit_code == 0, result.output
    assert read_marker_points(f"{bag}:{topic}")[topic.strip("/")].shape == (3,)
    expected = evaluate(*files, "--json")
    assert json.loads(result.output)["errors"] == json.loads(expected.output)["errors"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("RUN", "nothing.tum"), "nothing.tum"),
        (("RUN", "TRUTH", "--live"), "holds no trajectory_live.tum"),
        (("TRUTH", "TRUTH", "--live"), "--live is for a run's folder"),
        (("RUN", "TRUTH", "--tolerance", "0"), "tolerance 0.0 s is not positive"),
        (("RUN", "LATER"), "0 poses have a partner within 0.01 s"),
        (("TRUTH", "TRUTH", "--markers", "MARKERS"), "name a run's folder"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(files, tmp_path, arguments, message):
    later = reference()
    Trajectory(later.stamps + 10**12, later.positions, later.quaternions).write_tum(
        tmp_path / "later.tum"
    )
    names = {"RUN": files[0], "TRUTH": files[1], "LATER": tmp_path / "later.tum"}
    result = evaluate(*(names.get(a, a) for a in arguments))
    assert result.exit_code == 2
    assert message in result.output
    assert len(result.output.strip().splitlines()) == 1


def test_a_reference_of_positions_alone(files, tmp_path):
    true = reference()
    rows = [f"{s},{x},{y},{z}" for s, (x, y, z) in zip(true.stamps, true.positions, strict=True)]
    (tmp_path / "positions.csv").write_text("\n".join(rows))
    result = evaluate(files[0], tmp_path / "positions.csv")
    assert result.exit_code == 0, result.output
    assert "ATE translation" in result.output
    assert "no rotation errors and no RPE" in result.output
    refused = evaluate(files[0], tmp_path / "positions.csv", "--align", "origin")
    assert "choose another alignment" in refused.output


def test_a_straight_line_is_aligned_but_not_scaled():
    positions = np.linspace([0.0, 0, 0], [4.0, 0, 0], len(STAMPS))
    quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (len(STAMPS), 1))
    truth = GroundTruth(STAMPS, positions, quaternions)
    moved = Trajectory(STAMPS, positions + np.array([1.0, 2.0, 3.0]), quaternions)
    found = compare(moved, truth)
    assert found.errors["ate_translation"].max < 1e-9
    assert "the turn about it is arbitrary" in found.notes[0]
    with pytest.raises(EvaluationError, match="one straight line"):
        compare(moved, truth, align="sim3")
