# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration that a run has found, as a file."""

from dataclasses import replace

import pytest

from ruledgraph.app.found_calibration import calibration_summary, write_found_calibration
from ruledgraph.calibration import read_calibration
from ruledgraph.odometry import Odometry
from small_simulation import SMALL


def test_a_readout_that_was_found_is_written_with_the_first_rows_offset(tmp_path):
    """While running the stamps were those of the middle rows."""
    odometry = Odometry(replace(SMALL, line_delay=None, time_offset=0.03))
    write_found_calibration(odometry, tmp_path / "none.yaml")
    assert "line_delay" not in (tmp_path / "none.yaml").read_text()
    assert "readout_s" not in calibration_summary(odometry)
    odometry.mounting.read_rows_within(0.02)
    write_found_calibration(odometry, tmp_path / "found.yaml")
    found = read_calibration(tmp_path / "found.yaml")
    assert found.readout == pytest.approx(0.02)
    assert found.time_offset == pytest.approx(0.03 - 0.01)
    assert found.time_offset + found.middle_row_delay == pytest.approx(0.03)
