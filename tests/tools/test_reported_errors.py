# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Errors against what was reported with them."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from reported_errors import Segment, TruthSigma, reported_errors, segments_of
from ruledgraph.core.estimates import Estimate
from ruledgraph.evaluation import EvaluationError
from ruledgraph.evaluation.ground_truth import GroundTruth

STEP = 10**8
STAMPS = np.arange(10) * STEP


def truth_at(stamps: np.ndarray) -> GroundTruth:
    """Along x, 0.1 m a step."""
    positions = np.outer(stamps / STEP, [0.1, 0.0, 0.0])
    return GroundTruth(stamps, positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(stamps), 1)))


def estimates(off: np.ndarray, status: str = "tracking", segment: int = 0) -> list[Estimate]:
    """By 0.01 m uncertain along every axis, and off by so much, (10, 3)."""
    parts = (np.diag([1e-4] * 6), np.eye(3), np.eye(6))
    bias = gtsam.imuBias.ConstantBias()
    return [
        Estimate(
            int(stamp),
            gtsam.Pose3(gtsam.Rot3(), np.array([5.0 + 0.1 * i, 0.0, 0.0]) + off[i]),
            np.zeros(3),
            bias,
            parts,
            4,
            status,
            True,
            segment=segment,
        )
        for i, stamp in enumerate(STAMPS)
    ]


def late(far: float) -> np.ndarray:
    """The second half is off along y."""
    off = np.zeros((10, 3))
    off[5:, 1] = far
    return off


def test_errors_are_compared_with_the_covariance_that_came_with_them():
    good = estimates(late(0.0))
    assert reported_errors([Segment(good, good)], truth_at(STAMPS)).worst == pytest.approx(
        0.0, abs=1e-6
    )
    bad = estimates(late(0.2))
    found = reported_errors([Segment(bad, bad)], truth_at(STAMPS))
    assert found.worst == pytest.approx(200.0)
    assert found.three_sigma == pytest.approx(0.2 / 3.0 / np.hypot(0.01, 0.003))
    assert found.unreported == found.beyond == 0.5


def test_the_median_nees_is_one_for_errors_as_reported():
    # The first three, of which the beginning is known, are right; of the others the median counts.
    off = np.full((10, 3), 0.01 * np.sqrt(chi2.median(3) / 3.0))
    off[:4] = 0.0
    live, smoothed = estimates(off), estimates(np.zeros((10, 3)))
    found = reported_errors([Segment(live, smoothed)], truth_at(STAMPS), TruthSigma(0.0))
    assert found.nees == pytest.approx(1.0)


def test_small_errors_and_those_of_doubtful_estimates_are_beyond_but_not_unreported():
    for far, status in ((0.029, "tracking"), (0.2, "degraded")):
        off = estimates(late(far), status)
        sigma = TruthSigma(position=0.0)
        small = [replace(e, covariances=(e.covariances[0] / 9.0, *e.covariances[1:])) for e in off]
        found = reported_errors([Segment(small, small)], truth_at(STAMPS), sigma)
        assert (found.beyond, found.unreported) == (0.5, 0.0)


def test_a_wrong_scale_of_the_truth_is_not_held_against_an_estimate():
    """5 % too long: 45 mm at the end, of a truth whose scale is uncertain by 4 % and by none."""
    off = np.outer(0.05 * 0.1 * np.arange(10), [1.0, 0.0, 0.0])
    longer = estimates(off)
    segment = Segment(longer, estimates(np.zeros((10, 3))))
    strict = reported_errors([segment], truth_at(STAMPS), TruthSigma(0.0, 0.0))
    tolerant = reported_errors([segment], truth_at(STAMPS), TruthSigma(0.0, 0.04))
    assert strict.three_sigma == pytest.approx(0.045 / 0.03, rel=1e-6)
    assert tolerant.three_sigma == pytest.approx(0.045 / 3.0 / np.hypot(0.01, 0.036), rel=1e-6)


def test_of_a_sparse_truth_only_its_own_times_are_judged():
    """Every other estimate, which is right, and the rest far off."""
    off = np.zeros((10, 3))
    off[1::2, 1] = 1.0
    wrong = estimates(off)
    right = estimates(np.zeros((10, 3)))
    found = reported_errors([Segment(wrong, right)], truth_at(STAMPS[::2]))
    assert found.worst == pytest.approx(0.0, abs=1e-6)


def test_segments_are_apart_and_short_ones_left_out():
    live = estimates(late(0.0)) + estimates(late(0.0), segment=1)[:2]
    found = segments_of(live, live)
    assert [len(segment.live) for segment in found] == [10]
    with pytest.raises(EvaluationError, match="no estimates"):
        reported_errors([], truth_at(STAMPS))
