# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A sensor that stops for good, for a few seconds."""

import pytest

import silence


@pytest.mark.parametrize("case", silence.CASES)
def test_one_case(case):
    found = silence.try_case(case, live=False, minutes=0.1)
    assert found.status == ("waiting for images" if case == "camera stops" else "waiting for IMU")
    assert found.after > 0.0
