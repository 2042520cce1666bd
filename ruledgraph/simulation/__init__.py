# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated motion and sensors with exact ground truth."""

from ruledgraph.simulation.imu import SimulatedImu, simulate_imu
from ruledgraph.simulation.motion import SplineMotion

__all__ = ["SimulatedImu", "SplineMotion", "simulate_imu"]
