# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The command `simulate` and its files."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from ruledgraph.app.cli import main
from ruledgraph.calibration import read_calibration
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.core.trajectory import read_tum
from ruledgraph.recording import open_recording
from ruledgraph.simulation import MOTIONS, SCENES
from ruledgraph.simulation.options import simulation_from_options
from ruledgraph.simulation.write import write_simulation

SHORT = ("--duration", "0.5", "--resolution", "160x120", "--moving-start", "--seed", "3")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, ["simulate", *map(str, arguments)])


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("sim.bag", ()),
        ("sim.mcap", ()),
        ("sim_ros2", ("--format", "rosbag2")),
        ("sim_asl", ("--format", "asl")),
    ],
)
def test_what_is_written_is_what_was_simulated(
    tmp_path: Path, name: str, options: tuple[str, ...]
) -> None:
    out = tmp_path / name
    result = run("square", "free", out, *SHORT, *options)
    assert result.exit_code == 0, result.output
    stem = tmp_path / name.partition(".")[0]
    files = [Path(f"{stem}.{end}") for end in ("calib.yaml", "gt.tum", "lines.csv")]
    assert result.output.split() == [str(out), *map(str, files)]

    simulation = simulation_from_options(
        "square", "free", duration=0.5, resolution="160x120", moving_start=True, seed=3
    )

    # Formats may break ties in their own way.
    def order(m: Frame | ImuSample) -> tuple[int, bool]:
        return m.stamp, isinstance(m, Frame)

    written = sorted(open_recording(out).stream(), key=order)
    simulated = sorted(simulation.stream(), key=order)
    assert len(written) == len(simulated) == 45 + 101
    for one, other in zip(written, simulated, strict=True):
        assert type(one) is type(other)
        assert one.stamp == other.stamp
        if isinstance(one, Frame):
            assert np.array_equal(one.image, other.image)
        elif isinstance(one, ImuSample):
            np.testing.assert_array_equal(one.gyroscope, other.gyroscope)
            np.testing.assert_array_equal(one.accelerometer, other.accelerometer)

    calibration = read_calibration(files[0])
    assert calibration.camera == simulation.calibration.camera
    assert calibration.imu_noise == simulation.calibration.imu_noise
    assert calibration.body_T_cam.equals(simulation.calibration.body_T_cam, 1e-12)
    truth = read_tum(files[1])
    assert np.array_equal(truth.stamps, simulation.ground_truth.stamps)
    assert np.array_equal(truth.positions, simulation.ground_truth.position)
    with files[2].open(newline="") as file:
        _, *rows = csv.reader(file)
    assert tuple(row[0] for row in rows) == simulation.line_names
    ends = np.array([row[1:] for row in rows], dtype=float).reshape(-1, 2, 3)
    assert np.array_equal(ends, simulation.lines)


def test_the_readout_is_written_beside_the_recording(tmp_path: Path) -> None:
    result = run("square", "free", tmp_path / "o.bag", *SHORT, "--readout", "0.01")
    assert result.exit_code == 0, result.output
    assert read_calibration(tmp_path / "o.calib.yaml").readout == pytest.approx(0.01, rel=1e-12)


def test_ground_truth_topic_is_in_the_bag(tmp_path: Path) -> None:
    from ruledgraph.evaluation.ground_truth import read_ground_truth

    out = tmp_path / "sim.bag"
    assert run("square", "free", out, *SHORT).exit_code == 0
    topic = read_ground_truth("/ground_truth", open_recording(out))
    assert np.array_equal(topic.stamps, read_tum(tmp_path / "sim.gt.tum").stamps)


def test_list_names_everything_a_line_each() -> None:
    result = run("--list")
    assert result.exit_code == 0
    for name in (*SCENES, *MOTIONS):
        assert sum(line.split()[0] == name for line in result.output.splitlines()) == 1


def test_preview_alone(tmp_path: Path) -> None:
    path = tmp_path / "sheet.png"
    result = run("square", "free", "--preview", path, *SHORT)
    assert (result.exit_code, result.output) == (0, f"{path}\n")
    sheet = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert sheet.shape == (900, 1600)
    assert all(part.std() > 3.0 for row in np.vsplit(sheet, 3) for part in np.hsplit(row, 4))


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    for name in ("sim.bag", "sim.gt.tum", "sim.calib.yaml", "sim.lines.csv", "sheet.png"):
        existing = tmp_path / name
        existing.write_text("precious")
        result = run("square", "free", tmp_path / "sim.bag", "--preview", tmp_path / "sheet.png")
        assert result.exit_code == 2
        message = f"ruledgraph: {existing} exists already; remove it or choose another name\n"
        assert result.output == message
        assert [path.name for path in tmp_path.iterdir()] == [name]
        existing.unlink()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("garden", "free", "o.bag"), "unknown scene 'garden'; use one of square"),
        (("square", "loop", "o.bag"), "unknown motion 'loop'; use one of linear-parallel"),
        (("square", "free", "out"), "for a folder say --format rosbag2 or --format asl"),
        (("square", "free", "o.bag", "--resolution", "640"), "is not WIDTHxHEIGHT"),
        (("square", "free", "o.bag", "--imu", "good"), "IMU 'good' is none of d435i, euroc, none"),
        (("square", "free", "o.bag", "--duration", "-1"), "duration -1.0 s is not positive"),
        (("square", "free", "o.bag", "--start", "3"), "--start chooses a stretch of a measured"),
        (("square", "free", "o.bag", "--readout", "0.02"), "does not fit between frames at 90 Hz"),
        (("square", "free", "o.bag", "--readout", "-1"), "-1.0 is not in the range 0.0<=x<=1.0"),
        (("square", "free"), "name OUT, or --preview for a contact sheet alone"),
    ],
)
def test_mistakes_are_named_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert message in result.output
    assert "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


def test_resolution_keeps_the_field_of_view() -> None:
    camera = simulation_from_options("square", "free", resolution="1280x960").calibration.camera
    small = simulation_from_options("square", "free").calibration.camera
    # The outer corners of the image, half a pixel beyond the centres of its pixels.
    corners = np.array([[-0.5, -0.5], [1279.5, 959.5]])
    expected = small.undistort([[-0.5, -0.5], [639.5, 479.5]])
    np.testing.assert_allclose(camera.undistort(corners), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("room", "a.gt.tum", "a.bag"), "is read from there"),
        (("nosuch", "free", "a.bag"), "nosuch"),
        (("square", "free", "b.bag", "--calibration", "b.calib.yaml"), "is read from there"),
    ],
)
def test_force_removes_nothing_that_is_read_and_nothing_in_vain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    simulation = simulation_from_options("square", "free", duration=2.0, resolution="160x120")
    for stem in ("a", "b"):
        write_simulation(simulation, Path(f"{stem}.bag"), "rosbag1")
    before = {path: path.read_bytes() for path in Path().iterdir()}
    result = run(*words, "--force", "--duration", "1")
    assert result.exit_code == 2
    assert message in result.output
    assert {path: path.read_bytes() for path in Path().iterdir()} == before
