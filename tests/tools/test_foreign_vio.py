# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The whole graph of the C++ example, in Python and, where there is a GTSAM for it, in C++."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import foreign_vio
from cpp import FACTORS, build_with_gtsam

# One worker makes what they share.
pytestmark = pytest.mark.xdist_group("foreign VIO")


@pytest.fixture(scope="module")
def estimates() -> list[np.ndarray]:
    packets = foreign_vio.build(foreign_vio.simulate())
    return [foreign_vio.states(solve(packets)) for solve in foreign_vio.SOLVERS.values()]


def test_both_solvers_find_the_motion(estimates: list[np.ndarray]) -> None:
    for found in estimates:
        assert foreign_vio.position_rmse(found) < 0.005


def test_the_program_in_cpp_finds_the_same(estimates: list[np.ndarray], tmp_path: Path) -> None:
    program = build_with_gtsam(FACTORS / "examples", tmp_path) / "vio"
    _, theirs = foreign_vio.run_program(program)
    # GTSAM's versions differ a little in the covariance of their IMU factor.
    for here, there in zip(estimates, theirs, strict=True):
        assert np.abs(here - there).max() < 1e-4
