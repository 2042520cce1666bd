# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Why an estimate is not compared with ground truth."""

import numpy as np
import pytest

from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import EvaluationError, matched
from ruledgraph.evaluation.ground_truth import GroundTruth

TRUTH = GroundTruth(np.arange(0, 10**9, 10**7), np.ones((100, 3)), None)


def estimate(poses: int, begin: int = 0) -> Trajectory:
    stamps = begin + 5 * 10**7 * np.arange(poses)
    return Trajectory(stamps, np.zeros((poses, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (poses, 1)))


@pytest.mark.parametrize(
    ("trajectory", "message"),
    [
        (estimate(1), "not computed: 1 pose, at least 3 are needed"),
        (estimate(2), "not computed: 2 poses, at least 3 are needed"),
        (estimate(5, begin=10**10), "0 of 5 poses have ground truth at their time: the estimate"),
    ],
)
def test_what_is_lacking_is_said(trajectory, message):
    with pytest.raises(EvaluationError, match=message):
        matched(trajectory, TRUTH)


def test_three_poses_are_enough():
    kept, known = matched(estimate(3), TRUTH)
    assert len(kept) == len(known.positions) == 3
