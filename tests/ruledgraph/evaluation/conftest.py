# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Files of the tests of ground truth."""

from pathlib import Path

import pytest


@pytest.fixture
def file(tmp_path):
    """Writes a text to a new file and returns its path."""

    def write(text: str, name: str = "truth.txt") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
