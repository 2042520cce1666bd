# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A state and its covariance carried forward by the IMU to the frames that follow it."""

from typing import Protocol

import gtsam
import numpy as np

from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.arrays import FloatArray
from ruledgraph.imu.buffer import ImuBuffer, params_across
from ruledgraph_factors import FactorError, FrameMotion, preintegrate_frames
from ruledgraph_factors.so3 import hat

# s; frames are no nearer to their node, but for one at it.
_SHORTEST = 1e-9


def rotation_between(imu: ImuBuffer, start: float, stop: float) -> gtsam.Rot3:
    """start_R_stop of the body over [start, stop] (s), from the gyroscope alone."""
    rotation = gtsam.Rot3()
    for segment in imu.between(start, stop).segments(start, stop):
        rotation = rotation.compose(gtsam.Rot3.Expmap(segment.gyroscope * segment.dt))
    return rotation


def state_before(
    imu: ImuBuffer,
    state: gtsam.NavState,
    bias: gtsam.imuBias.ConstantBias,
    time: float,
    earlier: float,
) -> gtsam.NavState:
    """The state some time (s) before one at `time` (s), as far back as there are samples.

    R0 = R Exp(theta)^T,    v0 = v - g t - R0 dv,    p0 = p - v0 t - g t^2 / 2 - R0 dp,

    with (theta, dp, dv) preintegrated over the time t between them.
    """
    start = max(time - earlier, imu.earliest)
    motion = preintegrate_frames(imu.between(start, time), start, [time], bias)
    theta, dp, dv = np.split(motion.preintegrated[0], 3)
    t, gravity = time - start, imu.gravity
    R0 = state.attitude().compose(gtsam.Rot3.Expmap(theta).inverse())
    v0 = state.velocity() - gravity * t - R0.matrix() @ dv
    p0 = state.position() - v0 * t - gravity * (0.5 * t * t) - R0.matrix() @ dp
    return gtsam.NavState(R0, p0, v0)


class StateWithCovariance(Protocol):
    """A state at a time, s."""

    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    covariance: FloatArray
    """Of pose (rotation first, right perturbation), velocity and bias together, (15, 15)."""


def rotation_bound(imu: ImuBuffer, node: StateWithCovariance, time: float) -> float:
    """Bound of the angle by which the body turned from a state until a time (s), rad: the integral
    of |w - b|.
    """
    samples = imu.between(node.time, time)
    rates = np.linalg.norm(samples.gyroscope - node.bias.gyroscope(), axis=1)
    return float(np.trapezoid(rates, samples.times))


def rotated_half_turn(imu: ImuBuffer, node: StateWithCovariance, time: float) -> bool:
    """Whether the body turned by more than half a turn from a state until a time (s): then the
    rotation that is preintegrated is not unique.
    """
    if rotation_bound(imu, node, time) <= np.pi:
        return False
    try:
        preintegrate_frames(imu.between(node.time, time), node.time, [time], node.bias)
    except FactorError:
        return True
    return False


def propagated_covariances(
    node: StateWithCovariance, motion: FrameMotion, imu: ImuBuffer, noise: ImuNoise
) -> FloatArray:
    """Covariances of the states at all frames of a motion from a node, (n, 15, 15).

    P_t = F P F^T + Q: F is the derivative of the motion's equation (see `FrameMotion`) by the
    node's pose, velocity and bias. Q is the noise of gyroscope (G) and accelerometer (A) and the
    biases' random walk over the time t since the node. With f the mean specific force and

        d theta = n_g dt,    d p = v dt,    d v = S theta dt + n_a dt,    S = -[f]x,

    it is, by rotation, position and velocity, and symmetric,

        Q = [[G t],
             [S G t^3/6,    A t^3/3 + S G S^T t^5/20],
             [S G t^2/2,    A t^2/2 + S G S^T t^4/8,    A t + S G S^T t^3/3]].
    """
    R, count = node.state.attitude().matrix(), len(motion)
    bias = node.bias.vector()
    predicted = motion.predict(R, node.state.position(), node.state.velocity(), bias, imu.gravity)
    assert predicted.jacobian is not None  # noqa: S101 - it was asked for
    F = np.tile(np.eye(15), (count, 1, 1))
    F[:, :6] = predicted.jacobian[:, :, :15]
    gained = motion.corrected(bias)[:, 6:9]
    F[:, 6:9, :3] = -R @ hat(gained)
    F[:, 6:9, 9:] = R @ motion.bias_jacobian[:, 6:9]
    covariances = F @ node.covariance @ F.transpose(0, 2, 1)
    until = node.time + float(motion.elapsed[-1])
    params = noise.preintegration_params(imu.gravity)
    unreliable = imu.unreliable(node.time, until)
    if unreliable:
        params = params_across(noise, imu.gravity, unreliable, node.time, until)
    force = gained @ R.T / np.maximum(motion.elapsed, _SHORTEST)[:, None]
    return covariances + _noise(params, R, predicted.rotation, force, motion.elapsed)


def _noise(
    params: gtsam.PreintegrationCombinedParams,
    R: FloatArray,
    R_t: FloatArray,
    force: FloatArray,
    elapsed: FloatArray,
) -> FloatArray:
    """Q, from the attitudes at the node (3, 3) and at n frames, (n, 3, 3), and the mean specific
    force until then, (n, 3), in the world.
    """
    t = elapsed[:, None, None]
    G = R @ params.getGyroscopeCovariance() @ R.T
    A = R @ params.getAccelerometerCovariance() @ R.T
    S = -hat(force)
    SG, SGS = S @ G, S @ G @ S.transpose(0, 2, 1)
    Q = np.zeros((len(elapsed), 15, 15))
    Q[:, :3, :3] = G * t
    Q[:, 3:6, :3] = SG * (t**3 / 6.0)
    Q[:, 3:6, 3:6] = A * (t**3 / 3.0) + SGS * (t**5 / 20.0) + params.getIntegrationCovariance() * t
    Q[:, 6:9, :3] = SG * (t**2 / 2.0)
    Q[:, 6:9, 3:6] = A * (t**2 / 2.0) + SGS * (t**4 / 8.0)
    Q[:, 6:9, 6:9] = A * t + SGS * (t**3 / 3.0)
    Q[:, :3, 3:9] = Q[:, 3:9, :3].transpose(0, 2, 1)
    Q[:, 3:6, 6:9] = Q[:, 6:9, 3:6].transpose(0, 2, 1)
    # Of a pose the errors are in the frame's own axes.
    axes = np.tile(np.eye(15), (len(elapsed), 1, 1))
    axes[:, :3, :3] = axes[:, 3:6, 3:6] = R_t.transpose(0, 2, 1)
    Q = axes @ Q @ axes.transpose(0, 2, 1)
    Q[:, 9:12, 9:12] = params.getBiasAccCovariance() * t
    Q[:, 12:, 12:] = params.getBiasOmegaCovariance() * t
    return Q


class ImuPropagator:
    """Preintegrates from a state on, sample by sample, until `reset`."""

    def __init__(self, imu: ImuBuffer, noise: ImuNoise) -> None:
        self._imu = imu
        self._noise = noise
        self._preintegrated: gtsam.PreintegratedCombinedMeasurements | None = None
        self._until = 0.0

    def reset(self) -> None:
        """Begin anew: the state has changed, or there is a newer one."""
        self._preintegrated = None

    def predict(self, node: StateWithCovariance, time: float) -> gtsam.NavState:
        """The state at a later time, s, no earlier than asked for before."""
        if self._preintegrated is None:
            params = self._noise.preintegration_params(self._imu.gravity)
            self._preintegrated = gtsam.PreintegratedCombinedMeasurements(params, node.bias)
            self._until = node.time
        samples = self._imu.between(self._until, time)
        for segment in samples.segments(self._until, time, bias=node.bias):
            self._preintegrated.integrateMeasurement(*segment)
        self._until = time
        return self._preintegrated.predict(node.state, node.bias)

    def covariance(self, node: StateWithCovariance, time: float) -> FloatArray:
        """Of the state at a later time, (15, 15)."""
        if time <= node.time:
            return node.covariance
        samples = self._imu.between(node.time, time)
        motion = preintegrate_frames(samples, node.time, [time], node.bias)
        return np.asarray(propagated_covariances(node, motion, self._imu, self._noise)[0])
