# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images and IMU that contradict each other."""

import pytest

from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Innovation
from ruledgraph.core.messages import Messages
from ruledgraph.integrity.contradictions import ImuCheck
from ruledgraph.integrity.variance_factor import VarianceFactor


def test_what_disagrees_is_said_once_and_lasts_until_an_innovation_says_otherwise():
    warnings, config = Messages(), IntegrityConfig()
    check, factor = ImuCheck(warnings, config), VarianceFactor(config)
    far, near = Innovation(9e3, 9, -2.0), Innovation(9.0, 9, 1.5)
    for time, innovation in ((1.0, far), (2.0, None), (3.0, far)):
        check.update(innovation, time, factor, False)
        assert check.contradicts
    assert list(warnings) == [warnings[0]]
    assert "since 1.00 s" in warnings[0]
    check.update(near, 4.0, factor, False)
    assert not check.contradicts


@pytest.mark.parametrize("before", [Innovation(9e3, 9, -2.0), None])
def test_biases_that_jump_are_a_contradiction_that_is_solved(before):
    warnings, config = Messages(), IntegrityConfig()
    check, factor = ImuCheck(warnings, config), VarianceFactor(config)
    check.update(before, 1.0, factor, False)
    check.update(None, 2.0, factor, True)
    assert check.contradicts
    assert len(warnings) == 1
    check.update(None, 3.0, factor, False)
    assert not check.contradicts
