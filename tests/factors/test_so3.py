# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""SO(3) helpers against GTSAM and numerical derivatives, across the series' switching angles."""

import gtsam
import numpy as np
import pytest

from numerics import derivative, relative_error
from ruledgraph_factors import so3

ANGLES = [0.0, 1e-9, 1e-4, 0.05, 0.2999, 0.3001, 0.4999, 0.5001, 1.0, 2.5, 3.1]


def rotation_vector(angle: float) -> np.ndarray:
    axis = np.random.default_rng(round(angle * 1e6)).normal(size=3)
    return angle * axis / np.linalg.norm(axis)


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_and_right_jacobian_agree_with_gtsam(angle: float) -> None:
    theta = rotation_vector(angle)
    rotation, jacobian = so3.exp_and_right_jacobian(theta)
    np.testing.assert_allclose(rotation, gtsam.Rot3.Expmap(theta).matrix(), atol=1e-14)
    numeric = derivative(
        lambda t: gtsam.Rot3.Logmap(
            gtsam.Rot3.Expmap(theta).between(gtsam.Rot3(so3.exp_and_right_jacobian(t)[0]))
        ),
        theta,
        1e-4,
    )
    assert relative_error(jacobian, numeric) < 1e-9


@pytest.mark.parametrize("angle", ANGLES)
def test_inverse_right_jacobian_and_its_action_derivative(angle: float) -> None:
    theta = rotation_vector(angle)
    rate = np.array([0.4, -1.3, 0.7])
    inverse = so3.inverse_right_jacobian(theta)
    _, jacobian = so3.exp_and_right_jacobian(theta)
    np.testing.assert_allclose(inverse @ jacobian, np.eye(3), atol=1e-12)
    numeric = derivative(lambda t: so3.inverse_right_jacobian(t) @ rate, theta, 1e-3)
    analytic = so3.inverse_right_jacobian_action_derivative(theta, rate)
    assert relative_error(analytic, numeric) < 1e-8


def test_stacks_equal_single_calls() -> None:
    thetas = np.stack([rotation_vector(angle) for angle in ANGLES])
    rotations, jacobians = so3.exp_and_right_jacobian(thetas)
    inverses = so3.inverse_right_jacobian(thetas)
    for i, theta in enumerate(thetas):
        rotation, jacobian = so3.exp_and_right_jacobian(theta)
        np.testing.assert_array_equal(rotations[i], rotation)
        np.testing.assert_array_equal(jacobians[i], jacobian)
        np.testing.assert_array_equal(inverses[i], so3.inverse_right_jacobian(theta))
