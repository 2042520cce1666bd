# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines that wrap are reported, and the prior does not pull them back the way they came."""

from campaigns import line_wraps


def test_no_line_wraps_silently() -> None:
    outcomes = [line_wraps.run(seed) for seed in range(120)]
    far = [outcome for outcome in outcomes if outcome.far]
    assert len(far) > 5  # the starts are bad enough
    assert all(outcome.reported for outcome in far)
    assert not any(outcome.pulled or outcome.moved for outcome in outcomes)
