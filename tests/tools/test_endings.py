# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What counts as lost, and a few runs that end before their time."""

import json
import signal

import pytest

import endings
from small_simulation import write_small_recording

ROW = "{}.000000000 0.0 0.0 0.0 0.0 0.0 0.0 1.0\n"


def ending(folder, live=5, smoothed=5, counted=5, code=130, errors="", ended="interrupted"):
    folder.mkdir()
    for name, count in (("trajectory_live", live), ("trajectory", smoothed)):
        (folder / f"{name}.tum").write_text("".join(map(ROW.format, range(count))))
    (folder / "states.csv").write_text("stamp,lines,status,segment\n")
    (folder / "lines.csv").write_text("line\n")
    (folder / "summary.json").write_text(json.dumps({"ended": ended, "frames_estimated": counted}))
    return endings.Ending("SIGINT", code, errors, folder)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"smoothed": 3}, "2 frames are not there smoothed"),
        ({"counted": 7}, "5 live poses, but 7 frames estimated"),
        ({"errors": "Traceback:\nX\n"}, "more than one line of error, the last 'X'"),
        (
            {"errors": "ruledgraph: a\nruledgraph: b\n"},
            "more than one line of error, the last 'ruledgraph: b'",
        ),
        ({"smoothed": 3, "code": 4}, None),
        ({}, None),
    ],
)
def test_what_is_lost_is_named(tmp_path, monkeypatch, change, found):
    monkeypatch.setattr(endings, "read_run_tables", lambda _: None)
    assert list(endings.lost(ending(tmp_path / "run", **change))) == ([found] if found else [])


def test_a_missing_summary_and_a_torn_file_are_losses(tmp_path):
    run = ending(tmp_path / "a")
    (run.folder / "summary.json").write_text('{"ended": "inter')
    assert list(endings.lost(run)) == ["no summary"]
    run = ending(tmp_path / "b")
    (run.folder / "trajectory.tum").write_text("0.0 1.0 2")
    (problem,) = endings.lost(run)
    assert "3 columns" in problem


def test_a_signal_in_the_middle(tmp_path):
    bag = write_small_recording(tmp_path)
    arguments = [str(bag), "--calibration", str(tmp_path / "calib.yaml")]
    # However fast the machine is: at the end, or midway, and before only where it is slow.
    run = endings.run(arguments, tmp_path / "out", "SIGTERM", number=signal.SIGTERM, after=2.0)
    assert run.code in (0, 143, -signal.SIGTERM)
    assert list(endings.lost(run)) == []
