# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from types import SimpleNamespace

import gtsam
import numpy as np
import pytest

from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import propagated_covariances
from ruledgraph_factors import preintegrate_frames


def turning(seconds: float) -> ImuBuffer:
    """Samples at 200 Hz of a body that turns slowly and accelerates."""
    imu, rng = ImuBuffer(), np.random.default_rng(0)
    for time in np.arange(0.0, seconds, 0.005).tolist():
        rate = np.array([0.05, -0.1, 0.3]) + 1e-3 * rng.normal(size=3)
        imu.append(time, rate, np.array([0.4, -0.3, 9.81]) + 1e-3 * rng.normal(size=3))
    return imu


@pytest.mark.parametrize("elapsed", [0.05, 0.2, 1.0])
def test_a_known_states_covariance_grows_as_gtsams(elapsed: float) -> None:
    """By `PreintegratedCombinedMeasurements`, which adds up the noise of each sample."""
    imu, noise = turning(1.5), D435I_LIKE.at_least(0.01, 5e-4)
    attitude = gtsam.Rot3.Ypr(0.4, -0.2, 0.1)
    state = gtsam.NavState(attitude, np.zeros(3), np.array([0.3, 0.1, -0.2]))
    bias = gtsam.imuBias.ConstantBias(np.array([0.1, 0.0, -0.05]), np.array([0.01, 0.02, 0.0]))
    node = SimpleNamespace(time=0.1, state=state, bias=bias, covariance=np.zeros((15, 15)))
    samples = imu.between(0.1, 0.1 + elapsed)
    motion = preintegrate_frames(samples, 0.1, [0.1 + elapsed], bias)
    covariance = propagated_covariances(node, motion, imu, noise)[0]

    params = noise.preintegration_params(imu.gravity)
    gtsams = gtsam.PreintegratedCombinedMeasurements(params, bias)
    for segment in samples.segments(0.1, 0.1 + elapsed, bias=bias):
        gtsams.integrateMeasurement(*segment)
    # GTSAM's is of (theta, p, v) in the body's axes at the node, then of the biases.
    R = attitude.matrix()
    turn = gtsam.Rot3.Expmap(motion.corrected(bias.vector())[0, :3]).matrix()
    axes = np.eye(15)
    axes[3:6, 3:6], axes[6:9, 6:9] = turn.T, R
    expected = axes @ gtsams.preintMeasCov() @ axes.T
    sigmas = np.sqrt(np.diag(expected))
    # The walk of biases within the time is left out, and the mean force stands for all, whose
    # axes turn by 0.3 rad in a second.
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), sigmas, rtol=0.01)
    correlation = (covariance - expected)[:9, :9] / np.outer(sigmas, sigmas)[:9, :9]
    assert np.abs(correlation).max() < 0.04
