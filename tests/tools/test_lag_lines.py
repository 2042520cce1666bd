# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the embedding page says of lines in fixed-lag smoothers."""

import numpy as np
import pytest

from benchmarks.lag_lines import BATCH, INCREMENTAL, NEVER, Outcome, Run

# Not the seeds of the benchmark's own table.
SEEDS = range(1000, 1012)


def means(smoother: str, lag: float, threshold: float) -> Outcome:
    runs = [Run(seed, smoother, lag, threshold).follow() for seed in SEEDS]
    return Outcome(*np.mean(runs, axis=0))


def test_lines_that_move_are_consistent_with_ties_in_time_or_a_longer_lag() -> None:
    never, late, early = (means(INCREMENTAL, 0.6, threshold) for threshold in (NEVER, 0.1, 0.04))
    assert never.ties == 0.0 < late.ties < early.ties
    assert early.lines < late.lines < never.lines
    assert early.worst < never.worst
    longer = means(INCREMENTAL, 1.5, NEVER)
    # 95 % bounds of 12 means of four lines, were these independent, are 0.8 to 1.2.
    for consistent in (early, longer):
        assert consistent.lines < 1.2
        assert consistent.objected == 0.0


@pytest.mark.parametrize(("lag", "threshold"), [(0.6, 0.04), (1.5, NEVER)])
def test_the_batch_smoother_does_as_well(lag: float, threshold: float) -> None:
    assert means(BATCH, lag, threshold).lines < 1.2
