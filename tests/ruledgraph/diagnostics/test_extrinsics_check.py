# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether images turn as the gyroscope says."""

import dataclasses

import gtsam
import numpy as np
import pytest

from ruledgraph.core.measurements import ImuSample
from ruledgraph.diagnostics.extrinsics_check import check_rotation
from small_simulation import small_stream


def findings(stream, calibration):
    return list(check_rotation(stream[: len(stream) // 2], calibration))


def test_images_turn_as_the_gyroscope_says():
    stream, calibration = small_stream(moving=True)
    (finding,) = findings(stream, calibration)
    assert finding.good, finding
    still = [
        m._replace(gyroscope=0.0 * m.gyroscope) if isinstance(m, ImuSample) else m for m in stream
    ]
    assert findings(still, calibration) == []


def test_images_that_turn_otherwise_than_the_gyroscope_says_are_found():
    """Here it is in deg/s."""
    stream, calibration = small_stream(moving=True)
    in_degrees = [
        m._replace(gyroscope=np.degrees(m.gyroscope)) if isinstance(m, ImuSample) else m
        for m in stream
    ]
    finding = findings(in_degrees, calibration)[0]
    assert not finding.good
    assert " px" in finding.text


@pytest.mark.parametrize("axis", range(3))
def test_a_mounting_the_wrong_way_round_is_found(axis):
    stream, calibration = small_stream(moving=True)
    pose = calibration.body_T_cam
    turn = gtsam.Rot3.Expmap(0.5 * np.pi * np.eye(3)[axis])
    wrong = gtsam.Pose3(pose.rotation() * turn, pose.translation())
    (finding,) = findings(stream, dataclasses.replace(calibration, body_T_cam=wrong))
    assert not finding.good
    right = pose.rotation().matrix().T.round(4).tolist()
    assert f"with the rotation {right} (--set extrinsics.from_images" in finding.text


@pytest.mark.parametrize("offset", [-0.08, 0.08])
def test_a_wrong_time_offset_is_found(offset):
    stream, calibration = small_stream(moving=True)
    late = dataclasses.replace(calibration, time_offset=offset)
    good, bad_one = check_rotation(stream, late)
    assert good.good
    assert not bad_one.good
    said = f"the calibration says {1e3 * offset:.0f} ms; write timeshift_cam_imu: "
    before, found = bad_one.text.split(said)
    assert " ± " in before
    assert abs(float(found)) < 0.003  # the rendered recording's is zero
