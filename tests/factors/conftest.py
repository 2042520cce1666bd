# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The C++ program that several tests run."""

from pathlib import Path

import pytest

from cpp import CPP, build, stand_in


@pytest.fixture(scope="session")
def together(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`together.cpp` with the stand-in for GTSAM 4.3; for tests of one group of pytest-xdist."""
    # A function that is never called may lack what it calls.
    unused = ("-ffunction-sections", "-Wl,--gc-sections")
    return build(CPP / "together.cpp", tmp_path_factory.mktemp("cpp"), *stand_in(40300), *unused)
