# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The live example, two threads at the recording's own pace, as a user runs it."""

import re

import live_example
from ruledgraph.calibration import write_kalibr
from ruledgraph.recording import write_recording
from small_simulation import frames, small_stream


def test_it_prints_estimates_as_they_come(tmp_path, capsys):
    stream, calibration = small_stream()
    write_recording(stream, tmp_path / "small.bag", "rosbag1")
    write_kalibr(calibration, tmp_path / "calib.yaml")
    live_example.main(str(tmp_path / "small.bag"), str(tmp_path / "calib.yaml"))
    *poses, last = capsys.readouterr().out.splitlines()
    # A loaded machine may drop images; all but the first second's give estimates otherwise.
    assert len(poses) > 0.3 * len(frames(stream))
    assert all(re.fullmatch(r"[0-9.]+ s( +-?[0-9.]+){3} m ±[0-9.]+ [a-z ]+", p) for p in poses)
    assert re.match(r"[0-9]+ lines; Counts\(imu=[0-9]+, images=[0-9]+, dropped", last)
