# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's variables from interval to interval."""

import gtsam
import numpy as np
import pytest

from ruledgraph.backend.self_calibration import (
    AS_CALIBRATED,
    CameraVariables,
    SelfCalibration,
)
from ruledgraph.core.calibration_estimates import Extrinsics, FocalRatio, TimeOffset
from ruledgraph.core.config import Config

KNOWN = SelfCalibration(
    TimeOffset(0.01, 1e-3), Extrinsics(gtsam.Pose3(), 1e-4 * np.eye(6)), FocalRatio(1.0, 0.01)
)
STEP = 0.25


def in_a_row(period: float, count: int = 9) -> list[CameraVariables]:
    found: list[CameraVariables] = []
    for k in range(count):
        before = found[-1] if found else AS_CALIBRATED
        found.append(KNOWN.variables(k, k * STEP, 0.002, before, period))
    return found


@pytest.mark.parametrize(("period", "intervals"), [(0.0, 1), (0.25, 1), (1.0, 4)])
def test_mounting_and_focal_length_are_variables_of_some_intervals_in_a_row(period, intervals):
    cameras = in_a_row(period)
    shared = [k - k % intervals for k in range(len(cameras))]
    assert [camera.extrinsics.index for camera in cameras] == shared
    assert [camera.focal_ratio.index for camera in cameras] == shared
    # The offset's correction differs from interval to interval.
    assert [camera.time_offset.index for camera in cameras] == list(range(len(cameras)))


def test_a_shared_variable_is_tied_to_the_one_before_by_all_the_time_between():
    first, *_, fourth, fifth = in_a_row(1.0, 5)
    config = Config()
    assert [each.key for each in fourth.new_since(first)] == [fourth.time_offset.key]
    assert fifth.new_since(fourth) == fifth.estimated
    (walk,) = (f for f in fifth.factors(fourth, config) if isinstance(f, gtsam.BetweenFactorPose3))
    assert list(walk.keys()) == [first.extrinsics.key, fifth.extrinsics.key]
    # A second, whose root is 1.
    expected = np.repeat(
        [config.extrinsics.rotation_random_walk, config.extrinsics.translation_random_walk], 3
    )
    np.testing.assert_allclose(walk.noiseModel().sigmas(), expected, rtol=1e-12)


def test_the_first_ones_have_priors():
    (first,) = in_a_row(1.0, 1)
    factors = first.factors(AS_CALIBRATED, Config())
    assert [factor.size() for factor in factors] == [1, 1, 1]


def test_what_is_not_estimated_has_no_variable():
    assert SelfCalibration().variables(0, 0.0, 0.0, AS_CALIBRATED, 1.0) == AS_CALIBRATED
