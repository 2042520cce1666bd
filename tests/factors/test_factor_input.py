# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Bad input of the factors: it is named."""

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, E, G, L, T, V, X

from random_factors import random_case
from ruledgraph_factors import (
    FactorError,
    GeometricPoints,
    ImuSamples,
    ReprojectionPoints,
    preintegrate_frames,
    ruled_surface_factor,
    ruled_surface_factor_with_gravity_direction,
    ruled_surface_pose_factor,
)


def test_vectors_of_the_wrong_size_are_named() -> None:
    case = random_case(0)
    factor = case.factor("node")
    values = gtsam.Values(case.values)
    values.erase(L(0))
    values.insert(L(0), np.zeros(5))
    with pytest.raises(FactorError, match="l0 must hold a vector of 4, not of 5"):
        factor.error(values)


GOOD = random_case(0, frames=2)
GOOD_POINTS = GeometricPoints.from_frames(GOOD.frames)


def build(**changes):
    arguments = {
        "noise_model": noiseModel.Isotropic.Sigma(6, 1.0),
        "pose_key": X(0),
        "velocity_key": V(0),
        "bias_key": B(0),
        "line_key": L(0),
        "motion": GOOD.motion,
        "chart": GOOD.chart,
        "points": GOOD_POINTS,
    }
    return ruled_surface_factor(**(arguments | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"noise_model": noiseModel.Isotropic.Sigma(5, 1.0)},
            r"noise_model has dimension 5, but this factor has 6 rows \(3 for each frame\)",
        ),
        (
            {"points": ReprojectionPoints.from_frames(GOOD.frames)},
            r"noise_model has dimension 6, but this factor has 24 rows \(2 a point\)",
        ),
        ({"noise_model": 0.5}, "noise_model must be a gtsam.noiseModel, not float"),
        ({"pose_key": 1.5}, "pose_key must be an integer GTSAM key"),
        ({"pose_key": GOOD.motion}, "pose_key must be an .*, not a FrameMotion$"),
        ({"velocity_key": -1}, "velocity_key must be an integer GTSAM key"),
        ({"bias_key": True}, "bias_key must be an integer GTSAM key"),
        ({"line_key": X(0)}, "line_key is the same key as pose_key"),
        ({"motion": None}, "motion must be a FrameMotion, not NoneType"),
        ({"motion": GOOD.motion.select([0])}, "points has 2 frames, but motion has 1"),
        ({"chart": np.zeros(4)}, "chart must be a LineChart, not ndarray"),
        ({"points": GOOD.frames}, "points must be GeometricPoints or ReprojectionPoints"),
        ({"body_T_cam": np.eye(4)}, "body_T_cam must be a gtsam.Pose3, not ndarray"),
        (
            {"body_T_cam": gtsam.Pose3(np.diag([1.1, 1.0, 1.0, 1.0]))},
            "body_T_cam: its rotation is not orthonormal",
        ),
        (
            {"body_T_cam": gtsam.Pose3(gtsam.Rot3(), np.array([0.0, np.nan, 0.0]))},
            "body_T_cam has a NaN or infinite value",
        ),
        ({"gravity": [0.0, 9.81]}, r"gravity must have shape \(3,\), not \(2,\)"),
        ({"gravity": [0.0, 0.0, np.inf]}, "gravity has a NaN or infinite value"),
    ],
)
def test_bad_input_names_the_argument(changes: dict, message: str) -> None:
    build()
    with pytest.raises(FactorError, match=message):
        build(**changes)


def test_bad_gravity_magnitude_names_the_argument() -> None:
    with pytest.raises(FactorError, match=r"gravity_magnitude must be positive, not -9\.81"):
        ruled_surface_factor_with_gravity_direction(
            noiseModel.Isotropic.Sigma(6, 1.0),
            *(X(0), V(0), B(0), G(0), L(0)),
            *(GOOD.motion, GOOD.chart, GOOD_POINTS),
            gravity_magnitude=-9.81,
        )


def test_a_motion_without_time_is_named() -> None:
    with pytest.raises(FactorError, match=r"motion has no time_jacobian: use .*with_time=True"):
        ruled_surface_factor(
            noiseModel.Isotropic.Sigma(6, 1.0),
            *(X(0), V(0), B(0), L(0)),
            *(GOOD.motion.at_rest().select([0]), GOOD.chart),
            GeometricPoints.from_frames(GOOD.frames[:1]),
            time_key=T(0),
        )


def test_extrinsics_are_a_variable_or_given() -> None:
    with pytest.raises(FactorError, match="body_T_cam is the variable of extrinsics_key"):
        ruled_surface_pose_factor(
            noiseModel.Isotropic.Sigma(3, 1.0),
            *(X(0), L(0), GOOD.chart),
            GeometricPoints.from_frames(GOOD.frames[:1]),
            gtsam.Pose3(),
            extrinsics_key=E(0),
        )


def test_imu_samples_that_end_early_are_named() -> None:
    imu = ImuSamples([0.0, 0.1], np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(FactorError, match="IMU samples cover"):
        preintegrate_frames(imu, 0.0, [0.05, 0.2])
