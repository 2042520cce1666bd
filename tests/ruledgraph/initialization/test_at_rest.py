# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ideal_tracks import at_rest, ideal_tracks
from ruledgraph.backend.start import Start
from ruledgraph.core.config import Config
from ruledgraph.initialization.at_rest import start_at_rest
from ruledgraph.initialization.prior import Refusal
from ruledgraph_factors.so3 import hat


def test_a_start_at_rest_finds_gravity_and_the_gyroscope_bias():
    bias = np.array([0.0, 0.0, 0.0, 0.02, -0.05, 0.08])
    made = ideal_tracks(0, at_rest(1.0), duration=0.9, bias=bias)
    start = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(start, Start)
    np.testing.assert_allclose(start.bias.gyroscope(), bias[3:], atol=2e-3)
    np.testing.assert_array_equal(start.state.velocity(), 0.0)
    true_up = made.motion.rotation(0.0).T @ [0.0, 0.0, 1.0]
    own_up = start.state.attitude().matrix().T @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arccos(true_up @ own_up)) < 0.1
    # Yaw is the world's choice, and held tighter than the tilt.
    up_variance = own_up @ start.covariance[:3, :3] @ own_up
    assert up_variance == pytest.approx(1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_a_large_accelerometer_bias_is_within_the_reported_tilt(seed):
    bias = np.zeros(6)
    bias[:3] = np.random.default_rng(seed).normal(scale=0.35, size=3)  # 0.6 m/s^2 in length
    made = ideal_tracks(seed, at_rest(1.0), duration=0.9, bias=bias)
    start = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(start, Start)
    true_up = made.motion.rotation(0.0).T @ [0.0, 0.0, 1.0]
    own_up = start.state.attitude().matrix().T @ [0.0, 0.0, 1.0]
    sigma = np.sqrt(np.linalg.eigvalsh(start.covariance[:3, :3])[-1])
    assert np.arccos(true_up @ own_up) < 3.0 * sigma


@pytest.mark.parametrize("seed", range(3))
def test_tilt_and_accelerometer_bias_make_up_the_mean_force_together(seed):
    bias = np.zeros(6)
    bias[:3] = np.random.default_rng(seed).normal(scale=0.3, size=3)
    made = ideal_tracks(seed, at_rest(1.0), duration=0.9, bias=bias)
    start = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(start, Start)
    attitude = start.state.attitude()
    tilt = attitude.logmap(made.motion.pose(0.0).rotation())
    up = attitude.unrotate(np.array([0.0, 0.0, 1.0]))
    tilt = tilt - (tilt @ up) * up  # the yaw is the world's choice
    off = np.concatenate([tilt, bias[:3] - start.bias.accelerometer()])
    assert np.sqrt(np.diag(start.covariance)[9:12].max()) > 0.25  # alone neither is known
    together = np.hstack([hat(9.81 * up), np.eye(3)])  # b - theta x f
    part = np.ix_([0, 1, 2, 9, 10, 11], [0, 1, 2, 9, 10, 11])
    sigmas = np.sqrt(np.diag(together @ start.covariance[part] @ together.T))
    assert sigmas.max() < 0.05  # m/s^2
    assert np.all(np.abs(together @ off) < 3.0 * sigmas)


def test_an_accelerometer_in_g_is_refused_at_rest():
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    samples = made.imu.between(0.0, 0.9)
    made.imu.clear()
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        made.imu.append(float(time), w, f / 9.81)
    refusal = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(refusal, Refusal)
    assert "1.00 instead of 9.81" in refusal.reason


def test_the_tilts_sigma_is_what_the_accelerometers_bias_feigns():
    made = ideal_tracks(0, at_rest(1.0), duration=0.9)
    start = start_at_rest(made.imu, 800, 0.2, 0.8, Config())
    assert isinstance(start, Start)
    variances = np.linalg.eigvalsh(start.covariance[:3, :3])
    expected = Config().start.accelerometer_bias / 9.81  # rad; g differs by 0.1 % between places
    np.testing.assert_allclose(np.sqrt(variances[1:]), expected, rtol=2e-3)
