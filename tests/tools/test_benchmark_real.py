# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The tool that compares with published estimates: what is compared, over which time."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import benchmark_real
from benchmark_accuracy import REAL_SLICE
from benchmark_real import OURS, PEERS, figures, main, report
from ruledgraph.calibration import write_kalibr
from ruledgraph.core.config import Config
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.recording import write_recording
from small_simulation import small_stream

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("real benchmark")

START = 1_000_000_000_000


def flight(begin: float, end: float, error: float = 0.0) -> Trajectory:
    """A lively one at 20 Hz; `error`, m, up and down in turn until 16 s."""
    t = np.arange(round(20 * begin), round(20 * end) + 1) / 20.0
    positions = np.stack([np.sin(t), np.cos(2.0 * t), 0.3 * np.sin(3.0 * t)], axis=1)
    positions[:, 2] += np.where(t <= 16.0, error * (-1.0) ** np.round(20 * t), 0.0)
    rotations = Rotation.from_rotvec(np.outer(0.1 * t, [0.0, 0.0, 1.0])).as_quat()
    return Trajectory(START + np.rint(t * 1e9).astype(np.int64), positions, rotations)


def truth() -> GroundTruth:
    known = flight(-1.0, 31.0)
    return GroundTruth(known.stamps, known.positions, known.quaternions)


def test_both_stretches_common_and_own():
    estimates = {"late": flight(1.0, 29.9, error=0.01), "early": flight(-1.0, 31.0)}
    rows = figures(estimates, truth(), START)
    by = {(row.stretch.split()[0], row.over, row.estimate): row for row in rows}
    assert len(by) == 8
    assert {row.begin for row in rows if row.over == "common"} == {1.0}
    own = by["whole", "own", "early"]
    assert (own.begin, own.end, own.poses) == (0.0, 30.0, 601)
    assert by["moving", "common", "early"].end == 16.0
    # All of the error lies in the first 16 s.
    assert by["moving", "common", "late"].ate_rmse == pytest.approx(0.01, rel=0.01)
    assert by["whole", "common", "late"].ate_rmse == pytest.approx(0.01 * np.sqrt(301 / 579), 0.01)
    assert by["whole", "common", "early"].ate_rmse == pytest.approx(0.0, abs=1e-9)
    assert by["moving", "own", "late"].rpe_rmse > 0.005
    assert by["moving", "own", "early"].rpe_rmse == pytest.approx(0.0, abs=1e-9)


def test_an_error_outside_the_common_time_is_only_its_own():
    bad_start = flight(0.0, 30.0)
    bad_start.positions[:15, 0] += 0.5
    rows = figures({"bad": bad_start, "late": flight(1.0, 30.0)}, truth(), START)
    errors = {row.over: row.ate_rmse for row in rows if row.estimate == "bad"}
    assert errors["common"] == pytest.approx(0.0, abs=1e-9)
    assert errors["own"] > 0.05


def test_the_tables_show_millimetres():
    text = report(figures({"mine": flight(0.0, 30.0, error=0.02)}, truth(), START))
    assert "moving 16 s, over the time all cover:" in text
    assert "| mine | 0.00 to 16.00 | 321 |" in text
    assert "| 20.0 |" in text


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    (folder / REAL_SLICE.parent / "peers").mkdir(parents=True)
    stream, calibration = small_stream()
    bag = str(folder / REAL_SLICE)
    write_recording(stream, folder / f"{bag}.bag", "rosbag1")
    write_kalibr(calibration, folder / f"{bag}.calib.yaml")
    first = next(m.stamp for m in stream if hasattr(m, "image"))
    shift = first - START

    def moved(trajectory):
        stamps = trajectory.stamps + shift
        return Trajectory(stamps, trajectory.positions, trajectory.quaternions)

    moved(flight(-0.0, 31.0)).write_tum(f"{bag}.gt.tum")
    for file in PEERS.values():
        moved(flight(0.0, 30.0)).write_tum(folder / REAL_SLICE.parent / "peers" / file)
    (folder / "run").mkdir()
    for file in OURS.values():
        moved(flight(1.0, 30.0, error=0.01)).write_tum(folder / "run" / file)
    return folder


def call(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def test_a_kept_run_is_evaluated_beside_the_peers(data, tmp_path):
    file = tmp_path / "figures.json"
    result = call("--data", data, "--run", data / "run", "--json", file)
    assert result.exit_code == 0, result.output
    rows = json.loads(file.read_text())
    assert {row["estimate"] for row in rows} == {*OURS, *PEERS}
    by = {(r["estimate"], r["stretch"], r["over"]): r["ate_rmse"] for r in rows}
    assert by["ruledgraph, live", "moving 16 s", "own"] == pytest.approx(0.01, rel=0.01)
    assert by["points, mono", "moving 16 s", "own"] == pytest.approx(0.0, abs=1e-9)
    again = call("--data", data, "--run", data / "run", "--json", file)
    assert again.exit_code == 2
    assert "exists already" in again.output


def test_a_new_run_has_default_settings_and_is_kept(data, tmp_path, monkeypatch):
    def fake(given, config, output):
        assert given.calibration.camera.width == 320
        assert config == Config()
        assert sum(hasattr(m, "image") for m in given.measurements) > 100
        output.mkdir()
        for file in OURS.values():
            given.ground_truth.trajectory.write_tum(output / file)

    monkeypatch.setattr(benchmark_real, "run", fake)
    result = call("--data", data, "--keep", tmp_path / "kept")
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "kept").iterdir()} == set(OURS.values())


def test_a_folder_without_results_is_one_line(data, tmp_path):
    result = call("--data", data, "--run", tmp_path)
    assert result.exit_code == 2
    assert len(result.output.strip().splitlines()) == 1
    assert str(tmp_path) in result.output
