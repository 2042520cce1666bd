# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The measures of the paper's tables 1 to 5."""

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.evaluation.matching import EvaluationError, matched


@dataclass(frozen=True, eq=False)
class AxisDifferences:
    """Estimated less true position along the axes of the initial camera frame, m."""

    mean: FloatArray
    """Signed, x, y, z, (3,). The paper prints no signs."""
    std: FloatArray
    """(3,)."""
    poses: int


def first_pose_alignment(estimate: Trajectory, reference: GroundTruth) -> gtsam.Pose3:
    """reference_T_estimate that takes the first estimated pose to the true one at its time.

    Raises:
        EvaluationError: when they hardly overlap, or the reference has no orientations.
    """
    kept, truth = matched(estimate, reference)
    if truth.quaternions is None:
        raise EvaluationError("the reference has no orientations, so first poses cannot be aligned")
    return truth.trajectory.poses()[0].compose(kept.poses()[0].inverse())


def axis_differences(
    estimate: Trajectory, reference: GroundTruth, body_T_cam: gtsam.Pose3 | None = None
) -> AxisDifferences:
    """Mean and standard deviation of the camera's position error, first poses aligned.

    Args:
        estimate: world_T_body.
        reference: ground truth with orientations; it is interpolated at the estimate's stamps.
        body_T_cam: how the camera is mounted. By default the poses are taken for the camera's.

    Raises:
        EvaluationError: when they hardly overlap, or the reference has no orientations.
    """
    body_T_cam = gtsam.Pose3() if body_T_cam is None else body_T_cam
    reference_T_estimate = first_pose_alignment(estimate, reference)
    kept, truth = matched(estimate, reference)
    first_T_reference = truth.trajectory.poses()[0].compose(body_T_cam).inverse()
    places = [
        first_T_reference.transformFrom(
            np.column_stack([pose.compose(body_T_cam).translation() for pose in poses])
        )
        for poses in (
            [reference_T_estimate.compose(pose) for pose in kept.poses()],
            truth.trajectory.poses(),
        )
    ]
    difference = places[0] - places[1]
    return AxisDifferences(difference.mean(axis=1), difference.std(axis=1), len(kept))


@dataclass(frozen=True)
class LineDistances:
    """Distance of a true line's markers from the estimated line nearest to them, m."""

    name: str
    markers: int
    line: int
    """Index of the estimated line."""
    mean: float
    std: float


def point_line_distances(points: FloatArray, ends: FloatArray) -> FloatArray:
    """Distance of points (N, 3) from the infinite line through two `ends` (2, 3), (N,)."""
    direction = ends[1] - ends[0]
    direction = direction / np.linalg.norm(direction)
    return np.asarray(np.linalg.norm(np.cross(points - ends[0], direction), axis=1))


def line_distances(
    markers: Mapping[str, FloatArray], lines: FloatArray, reference_T_estimate: FloatArray
) -> list[LineDistances]:
    """How far estimated lines, unbounded, pass from the markers on true lines.

    Markers named `line/marker` belong to one line; others are all of one line. Which estimated line
    a true one is, is not known: it is taken for the nearest.

    Args:
        markers: name -> position, m, (3,).
        lines: two points of each estimated line, (L, 2, 3), m.
        reference_T_estimate: motion or similarity (4, 4) from the estimate to the markers' frame.

    Raises:
        EvaluationError: when there are no lines.
    """
    if len(lines) == 0:
        raise EvaluationError("no line was estimated that markers could be compared with")
    moved = lines @ reference_T_estimate[:3, :3].T + reference_T_estimate[:3, 3]
    groups: dict[str, list[FloatArray]] = {}
    for name, point in markers.items():
        group, slash, _ = name.rpartition("/")
        groups.setdefault(group if slash else "all markers", []).append(point)
    found = []
    for name, points in groups.items():
        distances = [point_line_distances(np.array(points), ends) for ends in moved]
        best = int(np.argmin([d.mean() for d in distances]))
        mean, std = float(distances[best].mean()), float(distances[best].std())
        found.append(LineDistances(name, len(points), best, mean, std))
    return found
