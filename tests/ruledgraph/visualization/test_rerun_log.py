# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""`ruledgraph smooth --rerun`, read back from its file."""

import csv
import os
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from ruledgraph.app.cli import main
from ruledgraph.core.measurements import Frame
from ruledgraph.core.trajectory import read_tum
from ruledgraph.visualization.rerun_log import RerunError, RerunLog
from small_simulation import small_stream, write_small_recording

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("Rerun log")


def smooth(recording: Path, *arguments: object) -> Result:
    calibration = recording.with_name("calib.yaml")
    return CliRunner().invoke(
        main, ["smooth", str(recording), "--calibration", str(calibration), *map(str, arguments)]
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    return write_small_recording(folder)


def read_back(path: Path) -> dict[str, dict[str, list]]:
    """Entity -> column -> values with the stamp of each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            from rerun.chunk import RrdReader
        except ImportError:
            from rerun.experimental import RrdReader
    found: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    with warnings.catch_warnings():
        # As a server that was stopped leaves it.
        warnings.filterwarnings("ignore", "RRD file has no footer")
        reader = RrdReader(str(path))
    for chunk in reader.stream():
        batch = chunk.to_record_batch()
        columns = dict(zip(batch.schema.names, batch.columns, strict=True))
        stamps = columns.get("stamp")
        for name, values in columns.items():
            if ":" in name:
                times = [None] * len(values) if stamps is None else stamps.cast("int64").to_pylist()
                pairs = zip(times, values.to_pylist(), strict=True)
                found[str(chunk.entity_path)][name.split(":")[1]] += [
                    (time, value) for time, value in pairs if value is not None
                ]
    return found


@pytest.fixture(scope="module")
def logged(recording, tmp_path_factory):
    pytest.importorskip("rerun")
    output = tmp_path_factory.mktemp("logged")
    unmerged = ("--set", "map.spacing=0")  # lines come one sighting each
    result = smooth(recording, "--output", output / "run", "--rerun", output / "run.rrd", *unmerged)
    assert result.exit_code == 0, result.output
    assert f"Rerun        rerun {output / 'run.rrd'}" in result.output
    return output / "run", read_back(output / "run.rrd")


def test_live_poses_are_there_at_their_stamps(logged):
    folder, found = logged
    live = read_tum(folder / "trajectory_live.tum")
    positions = dict(found["/world/body"]["translation"])
    assert sorted(positions) == live.stamps.tolist()
    there = np.array([positions[stamp] for stamp in live.stamps.tolist()]).reshape(-1, 3)
    np.testing.assert_allclose(there, live.positions, atol=1e-5)


@pytest.mark.parametrize(
    ("entity", "file"),
    [("/world/live", "trajectory_live.tum"), ("/world/smoothed", "trajectory.tum")],
)
def test_paths_are_pieces_from_pose_to_pose(logged, entity, file):
    folder, found = logged
    poses = read_tum(folder / file)
    pieces = dict(found[entity]["strips"])
    assert sorted(pieces) == poses.stamps[1:].tolist()
    there = np.array([pieces[stamp] for stamp in poses.stamps[1:].tolist()]).reshape(-1, 2, 3)
    np.testing.assert_allclose(there[:, 0], poses.positions[:-1], atol=1e-5)
    np.testing.assert_allclose(there[:, 1], poses.positions[1:], atol=1e-5)


def test_lines_and_their_ends_are_those_of_the_table(logged):
    folder, found = logged
    with (folder / "lines.csv").open() as file:
        rows = list(csv.DictReader(file))
    ends = [[[float(row[f"{a}{end}"]) for a in "xyz"] for end in (1, 2)] for row in rows]
    both = ("/world/lines", "/world/uncertain")
    assert all(found[entity]["strips"] for entity in both)
    strips = [v for entity in both for _, v in found[entity]["strips"]]
    points = [v for entity in both for _, v in found[f"{entity}/ends"]["positions"]]
    for there in (strips, points):
        there = np.array(there).reshape(-1, 6)
        wanted = np.array(ends).reshape(-1, 6)
        order = [np.abs(there - row).max(axis=1).argmin() for row in wanted]
        assert sorted(order) == list(range(len(rows)))
        np.testing.assert_allclose(there[order], wanted, rtol=1e-4, atol=1e-4)


def test_images_carry_rulings_and_points_of_the_same_frame(logged):
    import cv2

    _, found = logged
    frames = {m.stamp: m.image for m in small_stream()[0] if isinstance(m, Frame)}
    images = dict(found["/world/body/camera/image"]["blob"])
    assert set(images) <= set(frames)
    assert len(frames) - len(images) <= 2
    for stamp in list(images)[::40]:
        data = np.array(images[stamp][0], dtype=np.uint8)
        decoded = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).astype(float)
        assert np.abs(decoded - frames[stamp]).mean() < 4.0
    strips = dict(found["/world/body/camera/image/lines"]["strips"])
    points = dict(found["/world/body/camera/image/points"]["positions"])
    stamp = sorted(strips)[len(strips) // 2]
    assert len(strips[stamp]) > 3
    # Every edge point lies close to some ruling of its frame.
    curves = np.array(strips[stamp]).reshape(-1, 2)
    away = np.linalg.norm(np.array(points[stamp])[:, None] - curves[None], axis=2).min(axis=1)
    assert np.quantile(away, 0.9) < 10.0


def test_states_are_those_of_the_nodes(logged):
    folder, found = logged
    with (folder / "states.csv").open() as file:
        rows = list(csv.DictReader(file))
    velocities = found["/states/velocity"]["scalars"]
    assert len(velocities) == len(rows)
    there = np.array([value for _, value in sorted(velocities)])
    wanted = np.array([[float(row[f"velocity_{a}"]) for a in "xyz"] for row in rows])
    np.testing.assert_allclose(there, wanted, rtol=1e-6, atol=1e-9)
    for name in ("gyroscope_bias", "accelerometer_bias", "position_sigma", "lines"):
        assert len(found[f"/states/{name}"]["scalars"]) == len(rows)
    assert len(found["/world/window"]["strips"]) == len(rows)
    texts = [value[0] for _, value in found["/messages"]["text"]]
    assert {"still", "tracking"} <= set(texts)


def test_without_rerun_it_says_what_to_install(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    result = smooth(recording, "--output", tmp_path / "run", "--rerun", tmp_path / "run.rrd")
    assert result.exit_code == 2
    assert result.output == (
        "ruledgraph: --rerun needs the package rerun-sdk: pip install 'rerun-sdk>=0.39'\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_kept(recording, tmp_path):
    pytest.importorskip("rerun")
    (tmp_path / "mine.rrd").write_text("mine")
    result = smooth(recording, "--output", tmp_path / "run", "--rerun", tmp_path / "mine.rrd")
    assert result.exit_code == 2
    assert result.output.endswith("mine.rrd: exists already, choose another name\n")
    assert (tmp_path / "mine.rrd").read_text() == "mine"
    assert not (tmp_path / "run").exists()


def test_a_folder_that_is_none(tmp_path):
    pytest.importorskip("rerun")
    with pytest.raises(RerunError, match=r"run\.rrd: cannot be written"):
        RerunLog(tmp_path / "nowhere" / "run.rrd", small_stream()[1])


def test_a_run_that_never_began_leaves_no_file(recording, tmp_path):
    pytest.importorskip("rerun")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "kept.txt").write_text("mine")
    result = smooth(recording, "--output", tmp_path / "run", "--rerun", tmp_path / "run.rrd")
    assert result.exit_code == 2
    assert "is not empty" in result.output
    assert not (tmp_path / "run.rrd").exists()


def test_the_papers_solver_has_none(recording, tmp_path):
    result = smooth(recording, "--solver", "paper", "--rerun", tmp_path / "run.rrd")
    assert result.exit_code == 2
    assert "--rerun: is not supported by --solver paper" in result.output


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_run_is_streamed_to_a_viewer(logged, recording, tmp_path):
    """To Rerun's own server, which saves what comes instead of showing it."""
    port, received = free_port(), tmp_path / "received.rrd"
    program = Path(sys.executable).with_name("rerun")
    with subprocess.Popen(
        [program, "--save", received, "--port", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as viewer:
        try:
            wait_for(port)
            url = f"rerun+http://127.0.0.1:{port}/proxy"
            result = smooth(recording, "--output", tmp_path / "run", "--rerun", url)
            wait_until_saved(received)
        finally:
            # The program starts another one; an interrupt may be ignored, as in a job of a shell.
            os.killpg(viewer.pid, signal.SIGTERM)
            try:
                viewer.wait(20.0)
            except subprocess.TimeoutExpired:
                os.killpg(viewer.pid, signal.SIGKILL)
    assert result.exit_code == 0, result.output
    assert "\nRerun " not in result.output
    found = read_back(received)
    for entity, columns in logged[1].items():
        for name, values in columns.items():
            assert len(found[entity][name]) == len(values), (entity, name)


def wait_until_saved(file: Path) -> None:
    """Until it has not grown for two seconds: on a busy machine the server saves for some time."""
    size, unchanged = -1, 0
    for _ in range(300):
        now = file.stat().st_size if file.exists() else 0
        size, unchanged = now, unchanged + 1 if now == size else 0
        if unchanged == 20:
            return
        time.sleep(0.1)


def wait_for(port: int) -> None:
    for _ in range(200):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError(f"nothing listens on port {port}")


def test_a_viewer_that_does_not_answer(recording, tmp_path):
    pytest.importorskip("rerun")
    url = f"rerun+http://127.0.0.1:{free_port()}/proxy"
    result = smooth(recording, "--output", tmp_path / "run", "--rerun", url)
    assert result.exit_code == 2
    assert result.output.startswith(f"ruledgraph: --rerun {url}: no Rerun viewer answers (")
    assert len(result.output.splitlines()) == 1
    assert not (tmp_path / "run").exists()
