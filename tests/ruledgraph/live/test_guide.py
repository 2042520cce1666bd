# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The guide's live script, two threads at the recording's own pace, as a user runs it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import ruledgraph
from small_simulation import frames, small_stream, write_small_recording

PAGE = Path(ruledgraph.__file__).with_name("GUIDE.md")


@pytest.fixture
def script(tmp_path):
    blocks = re.findall(
        r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    (block,) = [block for block in blocks if "LiveOdometry" in block]
    path = tmp_path / "live.py"
    path.write_text(block, encoding="utf-8")
    return path


def test_it_is_short(script):
    assert len(script.read_text(encoding="utf-8").splitlines()) <= 40


def test_it_prints_estimates_as_they_come(script, tmp_path):
    recording = write_small_recording(tmp_path)
    command = [sys.executable, str(script), str(recording), str(tmp_path / "calib.yaml")]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stderr == ""
    *poses, last = run.stdout.splitlines()
    # A loaded machine may drop images; all but the first second's give estimates otherwise.
    assert len(poses) > 0.3 * len(frames(small_stream()[0]))
    assert all(re.fullmatch(r"[0-9.]+ s \[[-+0-9. e]+\] m [a-z ]+", pose) for pose in poses)
    assert re.match(r"Counts\(imu=[0-9]+, images=[0-9]+, dropped", last)
