# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Zero-velocity factors: one for each state of a rest."""

from itertools import pairwise
from types import SimpleNamespace

import gtsam
import pytest

from ruledgraph.backend.rest_factors import rest_factors
from ruledgraph.core.config import DEFAULTS


@pytest.mark.parametrize(
    ("times", "despite_imu"),
    [
        ([0.0, 0.2, 0.4, 0.6, 0.8, 0.85], ()),  # a short interval at the end
        ([0.0, 0.2, 0.4, 0.6, 0.8, 1.0], (1,)),
    ],
)
def test_no_state_gets_them_twice(times, despite_imu):
    intervals, known = [], []
    for i, (before, now) in enumerate(pairwise(times)):
        node = SimpleNamespace(index=i, time=before)
        rest = SimpleNamespace(
            node=node, still=True, is_rest_despite_imu=i in despite_imu, rest_factors=[]
        )
        intervals.append(rest)
        factors = rest_factors(intervals, now, DEFAULTS.rest)
        known += [f.keys()[0] for f in factors if isinstance(f, gtsam.PriorFactorVector)]
    assert len(known) == len(set(known)) > 2
