# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the estimates of a simulated recording, by their covariances: NEES."""

from collections.abc import Sequence

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import Estimate
from ruledgraph.integrity.gauge import yaw_alignment
from ruledgraph.simulation import Simulation

NEES_PARTS = {
    "pose": ("pose", slice(0, 6)),
    "velocity": ("velocity", slice(0, 3)),
    "bias": ("bias", slice(0, 6)),
    "orientation": ("pose", slice(0, 3)),
    "position": ("pose", slice(3, 6)),
    "accelerometer bias": ("bias", slice(0, 3)),
    "gyroscope bias": ("bias", slice(3, 6)),
}
"""Parts of the state: of which covariance, and where in it."""


def nees(
    estimates: Sequence[Estimate], beginning: Estimate, simulation: Simulation
) -> dict[str, FloatArray]:
    """e^T S^-1 e for each degree of freedom, of estimates and parts of them; place and heading of
    the world are fixed where the window began, which the covariances count from.
    """
    true = simulation.truth(np.array([beginning.stamp, *(e.stamp for e in estimates)]))
    poses = [
        gtsam.Pose3(gtsam.Rot3(R), p) for R, p in zip(true.rotation, true.position, strict=True)
    ]
    first = beginning.world_T_body
    yaw = yaw_alignment(true.rotation[:1], first.rotation().matrix()[None])
    shift = poses[0].translation() - yaw.rotate(first.translation())
    true_T_world = gtsam.Pose3(yaw, shift)
    found: dict[str, list[float]] = {name: [] for name in NEES_PARTS}
    for i, estimate in enumerate(estimates, start=1):
        error = true_T_world.compose(estimate.world_T_body).between(poses[i])
        states = {
            "pose": gtsam.Pose3.Logmap(error),
            "velocity": yaw.rotate(estimate.velocity) - true.velocity[i],
            "bias": estimate.bias.vector() - true.bias[i],
        }
        covariances = dict(zip(states, estimate.covariances, strict=True))
        for name, (state, part) in NEES_PARTS.items():
            e, S = states[state][part], covariances[state][part, part]
            found[name].append(float(e @ np.linalg.solve(S, e)) / len(e))
    return {name: np.array(values) for name, values in found.items()}
