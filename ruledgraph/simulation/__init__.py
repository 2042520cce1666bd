# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated recordings with exact ground truth: `simulate` is the way in."""

from ruledgraph.simulation.exposure import PERFECT, ImageQuality
from ruledgraph.simulation.imu import RecordedImu, SimulatedImu, simulate_imu
from ruledgraph.simulation.measured import MeasuredMotion
from ruledgraph.simulation.motion import Motion, SplineMotion
from ruledgraph.simulation.motions import MOTIONS, make_motion
from ruledgraph.simulation.scene import Scene
from ruledgraph.simulation.scenes import SCENES, make_scene
from ruledgraph.simulation.simulation import D435I, Simulation, TrueStates, simulate

__all__ = [
    "D435I",
    "MOTIONS",
    "PERFECT",
    "SCENES",
    "ImageQuality",
    "MeasuredMotion",
    "Motion",
    "RecordedImu",
    "Scene",
    "SimulatedImu",
    "Simulation",
    "SplineMotion",
    "TrueStates",
    "make_motion",
    "make_scene",
    "simulate",
    "simulate_imu",
]
