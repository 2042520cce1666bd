# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The camera's pose in the body: estimated by windows, kept between them, warned of."""

import dataclasses

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from failing_smoother import fail_updates
from ideal_tracks import CALIBRATION, error_of, frame_times, ideal_tracks, start_of
from ruledgraph.backend.sliding_window import Window
from ruledgraph.calibration.online_calibration import OnlineCalibration, mounting_warning
from ruledgraph.core.calibration_estimates import Extrinsics
from ruledgraph.core.config import Config, ExtrinsicsConfig
from ruledgraph.core.messages import Messages
from simulated_window import hand_held

TRUE = CALIBRATION.body_T_cam
DEFAULTS = ExtrinsicsConfig()
SIGMAS = np.repeat([DEFAULTS.rotation_sigma, DEFAULTS.translation_sigma], 3)


def turned(degrees: list[float]) -> gtsam.Pose3:
    """Where a calibration has the camera that is turned by so much."""
    turn = gtsam.Rot3.Expmap(np.radians(degrees))
    return TRUE.compose(gtsam.Pose3(turn, np.zeros(3)))


def run_window(given: gtsam.Pose3, seed: int = 1, estimate: bool = True) -> Window:
    """A hand-held camera's, with a calibration that has it elsewhere."""
    made = ideal_tracks(seed, hand_held(np.random.default_rng(seed)))
    calibration = dataclasses.replace(CALIBRATION, body_T_cam=given)
    extrinsics = Extrinsics(given, np.diag(SIGMAS**2)) if estimate else None
    window = Window(calibration, Config(), start_of(made), 0.0, extrinsics)
    for first in range(1, len(made.times), 3):
        part = slice(first, first + 3)
        window.extend(
            frame_times(made.stamps[part], made.times[part]), made.imu, made.tracks, False
        )
        window.optimize()
    return window


def nees(extrinsics: Extrinsics | None) -> float:
    assert extrinsics is not None
    error = extrinsics.body_T_cam.localCoordinates(TRUE)
    return float(error @ np.linalg.solve(extrinsics.covariance, error))


@pytest.mark.parametrize("degrees", [[1.0, 0.0, 0.0], [0.0, -2.0, 1.0], [2.0, 1.0, 2.0]])
def test_a_window_finds_how_the_camera_is_turned(degrees):
    """Within the 99.9 % quantile of its own covariance, and its poses are unharmed."""
    window = run_window(turned(degrees))
    found = window.self_calibration.extrinsics
    assert nees(found) < chi2.ppf(0.999, 6)
    assert found.body_T_cam.rotation().between(TRUE.rotation()).axisAngle()[1] < np.radians(0.2)
    assert window.recoveries == []


def test_without_it_the_poses_suffer():
    made = ideal_tracks(1, hand_held(np.random.default_rng(1)))
    errors = {}
    for estimate in (True, False):
        window = run_window(turned([2.0, 1.0, 2.0]), estimate=estimate)
        interval = window.intervals[-2]
        poses = zip(interval.stamps, interval.poses(), strict=True)
        errors[estimate] = max(error_of(p, made.motion.pose(stamp * 1e-9)) for stamp, p in poses)
    assert errors[True] < 0.02
    assert errors[False] > 2.0 * errors[True]


def test_its_covariance_is_what_it_is_said_to_be():
    """Mean NEES of 24 windows over its 6 degrees of freedom: 99 % of such means lie in 0.71 to 1.33
    were all Gaussian. The priors of new lines and the robust loss make it cautious, 0.56.
    """
    found = []
    for seed in range(24):
        off = np.random.default_rng([seed, 7]).normal(size=6) * SIGMAS
        found.append(nees(run_window(TRUE.retract(off), seed).self_calibration.extrinsics))
    assert 0.4 < np.mean(found) / 6.0 < 1.33


def test_a_smoother_that_is_rebuilt_keeps_it(monkeypatch):
    fail_updates(monkeypatch, 8, 13)
    window = run_window(turned([0.0, -2.0, 1.0]))
    assert len(window.recoveries) == 2
    found = window.self_calibration.extrinsics
    assert found.body_T_cam.rotation().between(TRUE.rotation()).axisAngle()[1] < np.radians(0.3)


def test_a_mounting_begins_with_the_calibration_and_keeps_what_is_found():
    warnings = Messages()
    online_calibration = OnlineCalibration(CALIBRATION, Config(), warnings)
    known = online_calibration.extrinsics
    assert known.body_T_cam is TRUE
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance)), SIGMAS)
    found = Extrinsics(turned([0.0, 1.5, 0.0]), np.eye(6) * 1e-6)
    online_calibration.update(found, None)
    online_calibration.update(None, None)
    assert online_calibration.extrinsics.body_T_cam is found.body_T_cam
    assert online_calibration.current == dataclasses.replace(
        CALIBRATION, body_T_cam=found.body_T_cam
    )
    assert list(warnings) == []
    for turn in [1.5] * (DEFAULTS.settled_states - 2) + [0.1] + [1.5] * DEFAULTS.settled_states:
        # What passes is not told.
        assert list(warnings) == []
        online_calibration.update(Extrinsics(turned([0.0, turn, 0.0]), np.eye(6) * 1e-6), None)
    assert list(warnings) == [
        "the camera is turned by 1.5 ± 0.1 deg from where the calibration has it on "
        "the IMU: correct T_cam_imu"
    ]
    off = OnlineCalibration(
        CALIBRATION, Config(extrinsics=ExtrinsicsConfig(estimate=False)), warnings
    )
    assert off.extrinsics is None


@pytest.mark.parametrize(
    ("degrees", "sigma", "warned"),
    [(1.0, 1e-3, True), (1.0, 7e-3, False), (0.3, 1e-3, False)],
    ids=["far", "not well known", "not far"],
)
def test_when_it_is_worth_a_warning(degrees, sigma, warned):
    found = Extrinsics(turned([degrees, 0.0, 0.0]), np.eye(6) * sigma**2)
    assert (mounting_warning(TRUE, found, DEFAULTS) is not None) == warned
