# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate and ground truth at the same times and in the same place."""

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import GroundTruth

# Ground truth is interpolated between samples this close together, s.
_LONGEST_STEP = 0.5
MIN_POSES = 3
"""A trajectory of fewer poses cannot be aligned."""


class EvaluationError(RuledgraphError):
    """Trajectories that cannot be compared."""


def matched(estimate: Trajectory, reference: GroundTruth) -> tuple[Trajectory, GroundTruth]:
    """The estimate where ground truth covers it, and ground truth interpolated at its stamps.

    Raises:
        EvaluationError: when they hardly overlap.
    """
    stamps = reference.stamps
    after = np.clip(np.searchsorted(stamps, estimate.stamps, side="left"), 1, len(stamps) - 1)
    inside = (estimate.stamps >= stamps[0]) & (estimate.stamps <= stamps[-1])
    inside &= (stamps[after] - stamps[after - 1]) * 1e-9 <= _LONGEST_STEP
    if len(estimate) < MIN_POSES:
        noun = "pose" if len(estimate) == 1 else "poses"
        raise EvaluationError(
            f"not computed: {len(estimate)} {noun}, at least {MIN_POSES} are needed"
        )
    if inside.sum() < MIN_POSES:
        raise EvaluationError(
            f"{inside.sum()} of {len(estimate)} poses have ground truth at their time: "
            + covered(estimate, reference)
        )
    kept = Trajectory(
        estimate.stamps[inside], estimate.positions[inside], estimate.quaternions[inside]
    )
    t = (kept.stamps - stamps[0]).astype(float)
    own = (stamps - stamps[0]).astype(float)
    positions = np.stack([np.interp(t, own, axis) for axis in reference.positions.T], axis=1)
    quaternions = None
    if reference.quaternions is not None:
        quaternions = reference.trajectory.at(kept.stamps).quaternions
    return kept, GroundTruth(kept.stamps, positions, quaternions)


def covered(estimate: Trajectory, reference: GroundTruth) -> str:
    """Which times both cover, for messages."""
    ours, theirs = estimate.stamps * 1e-9, reference.stamps * 1e-9
    return (
        f"the estimate covers {ours[0]:.3f} to {ours[-1]:.3f} s, "
        f"the ground truth {theirs[0]:.3f} to {theirs[-1]:.3f} s"
    )


def alignment(positions: FloatArray, reference: FloatArray) -> FloatArray:
    """Rigid motion (4, 4) that best takes positions onto the reference, (N, 3)."""
    centre, target = positions.mean(axis=0), reference.mean(axis=0)
    u, _, vt = np.linalg.svd((positions - centre).T @ (reference - target))
    rotation = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    return _motion(rotation, centre, target)


def yaw_alignment(positions: FloatArray, reference: FloatArray) -> FloatArray:
    """Turn about z and translation (4, 4) that best take positions onto the reference, (N, 3).

    The alignment of what gravity leaves open (Zhang and Scaramuzza 2018, section III).
    """
    centre, target = positions.mean(axis=0), reference.mean(axis=0)
    H = (positions - centre).T @ (reference - target)
    yaw = np.arctan2(H[0, 1] - H[1, 0], H[0, 0] + H[1, 1])
    c, s = np.cos(yaw), np.sin(yaw)
    return _motion(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), centre, target)


def _motion(rotation: FloatArray, centre: FloatArray, target: FloatArray) -> FloatArray:
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = rotation, target - rotation @ centre
    return motion
