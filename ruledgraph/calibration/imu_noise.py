# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Noise figures of IMUs."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph.core.errors import RuledgraphError
from ruledgraph_factors import STANDARD_GRAVITY

MIN_NOISE = 1e-12
"""Of any noise figure, in its SI unit. The best gyroscopes have 1e-8 rad/s/sqrt(Hz); squares of
less are lost beside those of the lines."""


@dataclass(frozen=True)
class ImuNoise:
    """White noise densities and bias random walks of an IMU."""

    gyroscope: float
    """rad/s/sqrt(Hz)."""
    accelerometer: float
    """m/s^2/sqrt(Hz)."""
    gyroscope_walk: float
    """rad/s^2/sqrt(Hz)."""
    accelerometer_walk: float
    """m/s^3/sqrt(Hz)."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not MIN_NOISE <= value < np.inf:
                raise RuledgraphError(
                    f"IMU noise figure {name} = {value} is not from {MIN_NOISE:g} on"
                )

    def at_least(self, accelerometer: float, gyroscope: float) -> "ImuNoise":
        """With white noise of no less than these."""
        return replace(
            self,
            accelerometer=max(self.accelerometer, accelerometer),
            gyroscope=max(self.gyroscope, gyroscope),
        )

    def preintegration_params(
        self, gravity: ArrayLike = STANDARD_GRAVITY
    ) -> gtsam.PreintegrationCombinedParams:
        """The same figures for GTSAM's `CombinedImuFactor`, with gravity in the world, m/s^2."""
        params = gtsam.PreintegrationCombinedParams(np.asarray(gravity, dtype=float))
        params.setGyroscopeCovariance(np.eye(3) * self.gyroscope**2)
        params.setAccelerometerCovariance(np.eye(3) * self.accelerometer**2)
        params.setBiasOmegaCovariance(np.eye(3) * self.gyroscope_walk**2)
        params.setBiasAccCovariance(np.eye(3) * self.accelerometer_walk**2)
        # Of GTSAM's own integration, which is that exact; none would be singular.
        params.setIntegrationCovariance(np.eye(3) * 1e-10)
        return params


D435I_LIKE = ImuNoise(2.44e-4, 1.47e-3, 2.0e-5, 3.0e-4)
"""Noise densities of the Bosch BMI055 data sheet, the D435i's IMU (0.014 deg/s/sqrt(Hz) and
150 ug/sqrt(Hz)); bias walks of the usual size for a consumer MEMS."""

ADIS16448_LIKE = ImuNoise(1.6968e-4, 2.0e-3, 1.9393e-5, 3.0e-3)
"""The figures of the EuRoC MAV dataset's `sensor.yaml`."""
