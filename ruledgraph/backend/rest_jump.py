# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the accelerometer's bias jumped while the body rests, as in a lift that sets off."""

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from ruledgraph.backend.bias_jump import JumpTest
from ruledgraph.backend.states import Interval
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.config import Config
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import propagated_covariances


def rest_jump(
    interval: Interval, imu: ImuBuffer, noise: ImuNoise, config: Config
) -> JumpTest | None:
    """A likelihood ratio test of whether the biases jumped in an interval over which the body
    rests; None without a covariance, when the smoother has failed.

    The velocity does not change, but by the IMU alone it does by d, with covariance S, which
    includes how still a resting body is. A jump of the biases, as unknown as before a start (B),
    changes d by J:

        2 log(p_jump / p_none) = d^T (S^-1 - (S + J B J^T)^-1) d,

    but for the determinants. Without a jump it is a chi-square of three degrees of freedom at most:
    they jumped where that is unlikely (`integrity.confidence`). The most likely jump is
    -B J^T (S + J B J^T)^-1 d.

    Args:
        interval: the newest one.
        imu: samples that cover it.
        noise: of the IMU.
        config: all settings; `start` says what is known of biases before one.
    """
    node, motion = interval.node, interval.motion.select([-1])
    change = motion.velocities(node.state, node.bias, imu.gravity)[0] - node.state.velocity()
    # The velocity before, right or wrong, says nothing of how it changes.
    known = node.covariance.copy()
    known[6:9], known[:, 6:9] = 0.0, 0.0
    before = replace(node, covariance=known)
    S = propagated_covariances(before, motion, imu, noise)[0, 6:9, 6:9]
    S = S + 2.0 * config.rest.velocity_sigma**2 * np.eye(3)
    J = node.state.attitude().matrix() @ motion.bias_jacobian[0, 6:9]
    by_bias = np.square(config.start.bias_sigmas)[:, None] * J.T
    try:
        root = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        return None
    of_jump = np.linalg.solve(S + J @ by_bias, change)
    ratio = float(np.sum(np.square(np.linalg.solve(root, change))) - change @ of_jump)
    by_chance = float(chdtri(len(change), 1.0 - config.integrity.confidence))
    return JumpTest(ratio, -by_bias @ of_jump, ratio > by_chance)
