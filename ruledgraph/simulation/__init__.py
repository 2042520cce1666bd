# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated motion and sensors with exact ground truth."""

from ruledgraph.simulation.imu import (
    ADIS16448_LIKE,
    D435I_LIKE,
    ImuNoise,
    SimulatedImu,
    simulate_imu,
)
from ruledgraph.simulation.motion import SplineMotion

__all__ = [
    "ADIS16448_LIKE",
    "D435I_LIKE",
    "ImuNoise",
    "SimulatedImu",
    "SplineMotion",
    "simulate_imu",
]
