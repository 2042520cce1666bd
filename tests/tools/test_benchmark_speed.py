# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark of speed: a short run."""

from click.testing import CliRunner

import benchmark_speed


def test_a_short_run(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark_speed, "MAX_LINES", (5, 30))
    arguments = ["--out", str(tmp_path / "speed"), "--repeat", "1", "--seconds", "1"]
    result = CliRunner().invoke(benchmark_speed.main, arguments)
    assert result.exit_code == 0, result.output
    for row in ("| simulated, 1 s |", "| between states |", "| the paper's solver |", "| 30 |"):
        assert row in result.output
    assert (tmp_path / "speed" / "lines.png").stat().st_size > 1000
