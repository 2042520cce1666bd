# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The newest state carried forward by the IMU to the frames that follow it."""

from typing import Protocol

import gtsam

from ruledgraph.calibration.sensors import ImuNoise
from ruledgraph.imu.buffer import ImuBuffer


def rotation_between(imu: ImuBuffer, start: float, stop: float) -> gtsam.Rot3:
    """start_R_stop of the body over [start, stop] (s), from the gyroscope alone."""
    rotation = gtsam.Rot3()
    for segment in imu.between(start, stop).segments(start, stop):
        rotation = rotation.compose(gtsam.Rot3.Expmap(segment.gyroscope * segment.dt))
    return rotation


class StateNode(Protocol):
    """A state at a time, s."""

    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias


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

    def predict(self, node: StateNode, time: float) -> gtsam.NavState:
        """The state at a later time, s, no earlier than asked for before."""
        if self._preintegrated is None:
            params = self._noise.preintegration_params()
            self._preintegrated = gtsam.PreintegratedCombinedMeasurements(params, node.bias)
            self._until = node.time
        samples = self._imu.between(self._until, time)
        for segment in samples.segments(self._until, time, bias=node.bias):
            self._preintegrated.integrateMeasurement(*segment)
        self._until = time
        return self._preintegrated.predict(node.state, node.bias)
