# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from benchmark_starts import report
from recorded_runs import Run


def made(begin: float, delay: float | None, ate: float | None) -> Run:
    return Run(begin, delay, delay, 0.0 if ate is None else 0.9, 0.0, ate, ate, 1.0, ())


def test_a_run_without_a_pose_is_the_worst():
    text = report([made(0.0, 1.0, 4.0), made(0.5, 1.2, 30.0), made(1.0, None, None)])
    assert "3 starts: first pose after 1.20 s (median), inf s at most, 67% within 1.3 s" in text
    assert "median 30.0 mm" in text
    assert "2 over 25 mm, 1 over 100 mm" in text
    assert "frames with a pose: 60.0%" in text


@pytest.mark.parametrize("count", [1, 3])
def test_a_line_for_each_run(count):
    runs = [made(float(i), 1.0, 2.0) for i in np.arange(count)]
    assert len(report(runs).split("\n\n")[0].splitlines()) == 1 + count
