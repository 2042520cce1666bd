# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines in GTSAM's own examples make no pose worse."""

import pytest

from benchmarks import foreign_graphs

# Not the seeds of the benchmark's own table.


@pytest.mark.parametrize("seed", [100, 101])
def test_lines_help_visual_isam2(seed: int) -> None:
    without, with_lines = foreign_graphs.SCENES["visual ISAM2"](seed)
    assert with_lines < without


def test_lines_help_a_twist() -> None:
    without, with_lines = foreign_graphs.SCENES["sick twist"](100)
    assert with_lines < 0.5 * without
