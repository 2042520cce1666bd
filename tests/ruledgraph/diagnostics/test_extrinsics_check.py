# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether images turn as the gyroscope says."""

import dataclasses

import gtsam
import numpy as np
import pytest

from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.core.settings import load_config
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


def with_gyroscope_times(factor, stream):
    return [
        m._replace(gyroscope=factor * m.gyroscope) if isinstance(m, ImuSample) else m
        for m in stream
    ]


def with_images(change, stream):
    return [
        Frame(m.stamp, np.ascontiguousarray(change(m.image))) if isinstance(m, Frame) else m
        for m in stream
    ]


def test_a_gyroscope_in_degrees_per_second_is_found():
    stream, calibration = small_stream(moving=True)
    (finding,) = findings(with_gyroscope_times(180.0 / np.pi, stream), calibration)
    assert not finding.good
    assert "fit it if it is in degrees per second" in finding.text


def test_images_that_turn_otherwise_than_the_gyroscope_says_are_found():
    stream, calibration = small_stream(moving=True)
    finding = findings(with_gyroscope_times(4.0, stream), calibration)[0]
    assert not finding.good
    assert finding.text.startswith("image points disagree with the gyroscope by ")
    assert " px, 0.1 to 0.15 are usual: check T_cam_imu" in finding.text


@pytest.mark.parametrize(
    ("mirror", "name"),
    [(lambda image: image[:, ::-1], "left to right"), (lambda image: image[::-1], "upside down")],
)
def test_mirrored_images_are_found(mirror, name):
    stream, calibration = small_stream(moving=True)
    (finding,) = findings(with_images(mirror, stream), calibration)
    assert not finding.good
    assert f"the images may be mirrored ({name}), for which no T_cam_imu is right" in finding.text
    # Turned by half a turn they are those of a camera that is mounted so.
    (turned,) = findings(with_images(lambda image: image[::-1, ::-1], stream), calibration)
    assert "T_cam_imu looks wrong" in turned.text
    assert "mirrored" not in turned.text


@pytest.mark.parametrize("offset", [-0.4, 0.2])
@pytest.mark.parametrize("turned", [False, True])
def test_an_offset_beyond_the_usual_range_is_found(offset, turned):
    """Also where another mounting would explain a part of what it does, but not as well."""
    stream, calibration = small_stream(moving=True)
    late = dataclasses.replace(calibration, time_offset=offset)
    if turned:
        pose = calibration.body_T_cam
        turn = gtsam.Rot3.Expmap(np.radians([0.0, 0.0, 2.0]))
        wrong = gtsam.Pose3(pose.rotation() * turn, pose.translation())
        late = dataclasses.replace(late, body_T_cam=wrong)
    (finding,) = check_rotation(stream, late)
    assert not finding.good
    before, found = finding.text.split("; smooth with --time-offset ")
    assert f"the calibration says {1e3 * offset:.0f} ms" in before
    assert abs(float(found.split(",")[0])) < 0.03


@pytest.mark.parametrize("axis", range(3))
def test_a_mounting_the_wrong_way_round_is_found(axis):
    stream, calibration = small_stream(moving=True)
    pose = calibration.body_T_cam
    turn = gtsam.Rot3.Expmap(0.5 * np.pi * np.eye(3)[axis])
    wrong = gtsam.Pose3(pose.rotation() * turn, pose.translation())
    (finding,) = findings(stream, dataclasses.replace(calibration, body_T_cam=wrong))
    assert not finding.good
    right = pose.rotation().matrix().T.round(4).tolist()
    assert f"with the rotation {right} (--set extrinsics.from_images=true uses it; " in finding.text
    assert "the translation of T_cam_imu has to be corrected, too" in finding.text


def test_what_is_set_already_is_not_advised():
    stream, calibration = small_stream(moving=True)
    pose = calibration.body_T_cam
    turn = gtsam.Rot3.Expmap(0.5 * np.pi * np.eye(3)[2])
    wrong = gtsam.Pose3(pose.rotation() * turn, pose.translation())
    config = load_config(None, ["extrinsics.from_images=true"])
    half = stream[: len(stream) // 2]
    wrongly_mounted = dataclasses.replace(calibration, body_T_cam=wrong)
    (finding,) = check_rotation(half, wrongly_mounted, config)
    assert "--set" not in finding.text
    assert "(extrinsics.from_images uses it; " in finding.text


@pytest.mark.parametrize("offset", [-0.08, 0.08])
def test_a_wrong_time_offset_is_found(offset):
    stream, calibration = small_stream(moving=True)
    late = dataclasses.replace(calibration, time_offset=offset)
    good, bad_one = check_rotation(stream, late)
    assert good.good
    assert not bad_one.good
    said = f"the calibration says {1e3 * offset:.0f} ms; smooth with --time-offset "
    before, found = bad_one.text.split(said)
    assert " ± " in before
    assert abs(float(found.split(",")[0])) < 0.003  # the rendered recording's is zero
