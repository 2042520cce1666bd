# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations whose T_cam_imu is off, by a little or grossly, in the whole odometry."""

import dataclasses
import re

import gtsam
import numpy as np
import pytest

from ruledgraph.core.settings import load_config
from ruledgraph.odometry import Odometry
from small_runs import ate
from small_simulation import small_simulation, small_stream

DURATION = 6.0


def run(body_T_cam: gtsam.Pose3, *settings: str, moving: bool = True) -> tuple[Odometry, float]:
    """The odometry at the end of a recording begun in motion, or at rest, and its live ATE, m."""
    stream, calibration = small_stream(moving=moving, duration=DURATION)
    calibration = dataclasses.replace(calibration, body_T_cam=body_T_cam)
    odometry = Odometry(calibration, load_config(None, settings))
    for measurement in stream:
        odometry.add(measurement)
    simulation = small_simulation(moving=moving, duration=DURATION)
    return odometry, ate(odometry.take_live(), simulation)


def error_deg(odometry: Odometry, true: gtsam.Pose3) -> float:
    found = odometry.online_calibration.current.body_T_cam
    return float(np.degrees(true.rotation().between(found.rotation()).axisAngle()[1]))


@pytest.mark.parametrize("moving", [True, False])
def test_a_rotation_that_is_off_by_three_degrees_is_found_and_reported(moving):
    true = small_stream(moving=True, duration=DURATION)[1].body_T_cam
    turn = gtsam.Rot3.Expmap(np.radians(3.0) * np.array([0.6, 0.0, 0.8]))
    turned = true.compose(gtsam.Pose3(turn, np.zeros(3)))
    # As soon and as well as six seconds, the first of them at rest, tell it: 0.2 degrees.
    odometry, error = run(turned, "extrinsics.settled_states=5", moving=moving)
    assert error_deg(odometry, true) < 0.2
    assert error < 0.01
    warned = re.search(r"turned by ([0-9.]+) ± ([0-9.]+) deg", str(odometry.warnings))
    assert warned is not None
    # It is warned as soon as it is known well.
    assert abs(float(warned[1]) - 3.0) < 3.0 * float(warned[2])
    _, held = run(turned, "extrinsics.estimate=false", moving=moving)
    assert held > 1.5 * error


def test_exchanged_axes_are_reported_and_replaced_on_request():
    true = small_stream(moving=True, duration=DURATION)[1].body_T_cam
    exchanged = gtsam.Pose3(gtsam.Rot3(np.eye(3)[[2, 0, 1]]), np.zeros(3))
    odometry, error = run(true.compose(exchanged), "extrinsics.from_images=true")
    (warning,) = (w for w in odometry.warnings if "T_cam_imu looks wrong" in w)
    assert "px with the rotation [[" in warning
    assert error_deg(odometry, true) < 0.3
    assert error < 0.02


def test_exchanged_axes_are_found_where_the_time_offset_is_exact():
    true = small_stream(moving=True, duration=DURATION)[1].body_T_cam
    exchanged = true.compose(gtsam.Pose3(gtsam.Rot3(np.eye(3)[[1, 2, 0]]), np.zeros(3)))
    settings = "extrinsics.from_images=true", "time_offset.estimate=false"
    odometry, error = run(exchanged, *settings)
    assert sum("T_cam_imu looks wrong" in w for w in odometry.warnings) == 1
    assert error < 0.02
