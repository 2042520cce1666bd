# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of a trajectory against ground truth, computed by evo.

evo is under the GPL, version 3: it is imported here alone, and only when something is evaluated.
"""

from dataclasses import dataclass

import numpy as np

from ruledgraph.errors import RuledgraphError
from ruledgraph.ground_truth import GroundTruth
from ruledgraph.sensors import FloatArray
from ruledgraph.trajectory import Trajectory

# Ground truth is interpolated between samples this close together, s.
_LONGEST_STEP = 0.5
_FEWEST_POSES = 3
# RPE is taken over this length, m.
_RPE_LENGTH = 1.0


class EvaluationError(RuledgraphError):
    """Trajectories that cannot be compared."""


@dataclass(frozen=True)
class Accuracy:
    """ATE after SE(3) alignment without scale, RPE over a length; metres and degrees."""

    poses: int
    path_length: float
    ate_rmse: float
    ate_max: float
    ate_rotation_rmse: float | None
    rpe_rmse: float | None
    """Of the translation over 1 m of path; None for a path too short."""


def matched(estimate: Trajectory, reference: GroundTruth) -> tuple[Trajectory, GroundTruth]:
    """The estimate where ground truth covers it, and ground truth interpolated at its stamps.

    Raises:
        EvaluationError: when they hardly overlap.
    """
    stamps = reference.stamps
    after = np.clip(np.searchsorted(stamps, estimate.stamps, side="left"), 1, len(stamps) - 1)
    inside = (estimate.stamps >= stamps[0]) & (estimate.stamps <= stamps[-1])
    inside &= (stamps[after] - stamps[after - 1]) * 1e-9 <= _LONGEST_STEP
    if inside.sum() < _FEWEST_POSES:
        raise EvaluationError(
            f"{inside.sum()} of {len(estimate)} poses have ground truth at their time: the "
            f"estimate covers {estimate.stamps[0] * 1e-9:.3f} to {estimate.stamps[-1] * 1e-9:.3f} "
            f"s, the ground truth {stamps[0] * 1e-9:.3f} to {stamps[-1] * 1e-9:.3f} s"
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


def accuracy(estimate: Trajectory, reference: GroundTruth) -> Accuracy:
    """ATE and RPE of an estimate, SE(3)-aligned, by evo.

    Raises:
        EvaluationError: when they hardly overlap.
    """
    from evo.core import metrics
    from evo.core.geometry import GeometryException
    from evo.core.trajectory import PoseTrajectory3D

    kept, truth = matched(estimate, reference)
    has_rotation = truth.quaternions is not None
    quaternions = (
        truth.quaternions if has_rotation else np.tile([0.0, 0.0, 0.0, 1.0], (len(kept), 1))
    )
    seconds = (kept.stamps - kept.stamps[0]) * 1e-9
    ours = PoseTrajectory3D(kept.positions, kept.quaternions[:, [3, 0, 1, 2]], seconds)
    theirs = PoseTrajectory3D(truth.positions, np.asarray(quaternions)[:, [3, 0, 1, 2]], seconds)
    try:
        ours.align(theirs, correct_scale=False)
    except GeometryException:  # all on one straight line: any turn about it fits as well
        ours.transform(alignment(kept.positions, truth.positions))

    def statistics(metric: metrics.PE) -> dict[str, float]:
        metric.process_data((theirs, ours))
        return dict(metric.get_all_statistics())

    ate = statistics(metrics.APE(metrics.PoseRelation.translation_part))
    rotation = rpe = None
    if truth.quaternions is not None:
        rotation = statistics(metrics.APE(metrics.PoseRelation.rotation_angle_deg))["rmse"]
        if theirs.path_length > 2.0 * _RPE_LENGTH:
            relation = metrics.PoseRelation.translation_part
            pairs = metrics.RPE(relation, _RPE_LENGTH, metrics.Unit.meters, all_pairs=True)
            rpe = statistics(pairs)["rmse"]
    return Accuracy(len(kept), theirs.path_length, ate["rmse"], ate["max"], rotation, rpe)


def alignment(positions: FloatArray, reference: FloatArray) -> FloatArray:
    """Rigid motion (4, 4) that best takes positions onto the reference, (N, 3)."""
    centre, target = positions.mean(axis=0), reference.mean(axis=0)
    u, _, vt = np.linalg.svd((positions - centre).T @ (reference - target))
    rotation = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = rotation, target - rotation @ centre
    return motion
