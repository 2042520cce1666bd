# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a run that yielded little may come from, likeliest first."""

import pytest

from ruledgraph.app.likely_causes import likely_causes
from ruledgraph.core.config import DEFAULTS
from ruledgraph.core.measurements import ImuSample
from ruledgraph.recording import write_recording
from small_simulation import small_stream


@pytest.mark.parametrize(("unit", "name"), [(9.81, "g"), (9.81e-3, "mg"), (0.01, "cm/s^2")])
def test_the_unit_of_the_accelerometer_comes_first(tmp_path, unit, name):
    stream, calibration = small_stream(moving=True)
    written = [
        m._replace(accelerometer=m.accelerometer / unit) if isinstance(m, ImuSample) else m
        for m in stream
        if m.stamp < stream[0].stamp + 2 * 10**9
    ]
    write_recording(written, tmp_path / "a.bag", "rosbag1")
    causes = likely_causes(tmp_path / "a.bag", calibration, DEFAULTS, {})
    assert causes[0].startswith("the mean accelerometer norm is ")
    assert f"in {name}" in causes[0]


def test_a_recording_that_is_too_short_says_so_first(tmp_path):
    stream, calibration = small_stream(moving=True)
    written = [m for m in stream if m.stamp < stream[0].stamp + 10**9]
    write_recording(written, tmp_path / "a.bag", "rosbag1")
    (cause, *_) = likely_causes(tmp_path / "a.bag", calibration, DEFAULTS, {})
    assert cause == "the recording is only 1.0 s long: a start in motion takes at least 1.6 s"
