# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from benchmark_readout import SCENES, Case, jobs_of, row, table
from ruledgraph.app.batch.work import Outcome


def outcome(ate: float | None) -> Outcome:
    if ate is None:
        return Outcome("it broke")
    errors = {name: {"ate_rmse": ate} for name in ("trajectory_live", "trajectory")}
    return Outcome("", {"frames": 10, "frames_estimated": 9, "accuracy": errors})


def test_only_the_readout_that_is_ignored_is_replaced():
    known, ignored = (jobs_of(Case(SCENES[0], 20, way), 2) for way in (True, False))
    assert [job.inputs.readout for job in known] == [None, None]
    assert [job.inputs.readout for job in ignored] == [0.0, 0.0]
    assert all("readout=0.02" in job.recording for job in known + ignored)
    assert len({job.name for job in known + ignored}) == 4


def test_a_row_has_median_and_range_and_a_run_that_failed_is_the_worst():
    cells = row(Case("a:b", 20, True), [outcome(1e-3), outcome(3e-3), outcome(2e-3)])
    assert cells == ["a:b", "20", "known", "2.0 (1.0 to 3.0)", "2.0 (1.0 to 3.0)", "90"]
    failed = row(Case("a:b", 0, True), [outcome(1e-3), outcome(None)])
    assert failed[2:] == ["global", "inf (1.0 to inf)", "inf (1.0 to inf)", "0"]
    assert len(table([cells, failed]).splitlines()) == 4
