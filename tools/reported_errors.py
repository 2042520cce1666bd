# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of live positions against the covariance and the status that were reported with them.

Each segment is compared in the world of its beginning: place and heading there are its own.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import EvaluationError, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.integrity.gauge import yaw_alignment

UNREPORTED_SHARE = 0.01
"""A run is unreported where it has more of them, see `ReportedErrors.unreported`."""
# Errors below this (m) are not held against an estimate, whatever its covariance.
_UNREPORTED_ERROR = 0.03
# Fewest poses of a segment that is judged, and how much of it says where it began, s.
_MIN_POSES, _BEGINNING = 3, 0.3
# Between samples of the truth that are further apart, only estimates that are this close to one are
# judged, both s: a hand moves by more than its uncertainty from a straight way in between.
_SPARSE, _NEAR = 0.1, 0.005


class TruthSigma(NamedTuple):
    """What ground truth is uncertain by: added to the covariance."""

    position: float = 0.003
    """Of each coordinate, m."""
    scale: float = 0.0
    """Of its scale: this share of the way from the beginning."""


@dataclass
class Segment:
    """The estimates between a start and a break."""

    live: list[Estimate] = field(default_factory=list)
    smoothed: list[Estimate] = field(default_factory=list)


class ReportedErrors(NamedTuple):
    """Of all live estimates."""

    worst: float
    """The largest error, mm."""
    three_sigma: float
    """The largest error over its three sigmas."""
    beyond: float
    """Share beyond three sigmas: 2.9 % of Gaussian errors in three dimensions."""
    unreported: float
    """Share, of those called tracking or still, beyond three sigmas and 30 mm."""
    nees: float
    """The median NEES, as a share of the one it should have."""


def segments_of(live: Iterable[Estimate], smoothed: Iterable[Estimate]) -> list[Segment]:
    """The segments of a run that are long enough to be judged."""
    found: dict[int, Segment] = {}
    for estimate in live:
        found.setdefault(estimate.segment, Segment()).live.append(estimate)
    for estimate in smoothed:
        found.setdefault(estimate.segment, Segment()).smoothed.append(estimate)
    return [s for s in found.values() if min(len(s.live), len(s.smoothed)) >= _MIN_POSES]


def reported_errors(
    segments: Sequence[Segment], truth: GroundTruth, sigma: TruthSigma | None = None
) -> ReportedErrors:
    """Errors and the covariance that came with them, of one segment or more.

    Raises:
        EvaluationError: when the estimates and the truth hardly overlap, or the truth has no
            orientations.
    """
    errors, ratios, trusted = [], [], []
    for segment in segments:
        world_T_true = _beginning(segment, truth)
        judged = _near_samples(segment.live, truth)
        if len(judged) < _MIN_POSES:
            continue
        kept, true = matched(trajectory_of(judged), truth)
        by_stamp = {estimate.stamp: estimate for estimate in judged}
        places = [world_T_true.transformFrom(place) for place in true.positions]
        for stamp, place in zip(kept.stamps.tolist(), places, strict=True):
            estimate = by_stamp[stamp]
            R = estimate.world_T_body.rotation().matrix()
            error = estimate.world_T_body.translation() - place
            errors.append(float(np.linalg.norm(error)))
            way = R.T @ (place - places[0])
            ratios.append(_over_three_sigma(R.T @ error, way, estimate, sigma or TruthSigma()))
            trusted.append(estimate.status in ("tracking", "still"))
    if not errors:
        raise EvaluationError("no estimates that ground truth says something of")
    e, r, t = np.array(errors), np.array(ratios), np.array(trusted)
    unreported = np.sum((r > 1.0) & (e > _UNREPORTED_ERROR) & t) / max(t.sum(), 1)
    nees = (3.0 * float(np.median(r))) ** 2 / float(chdtri(3, 0.5))
    return ReportedErrors(
        1e3 * float(e.max()), float(r.max()), float(np.mean(r > 1.0)), float(unreported), nees
    )


def trajectory_of(estimates: Sequence[Estimate]) -> Trajectory:
    """Poses with their stamps."""
    return Trajectory.from_poses([e.stamp for e in estimates], [e.world_T_body for e in estimates])


def _near_samples(estimates: Sequence[Estimate], truth: GroundTruth) -> list[Estimate]:
    stamps = np.array([estimate.stamp for estimate in estimates])
    after = np.clip(np.searchsorted(truth.stamps, stamps), 1, len(truth.stamps) - 1)
    before, behind = truth.stamps[after - 1], truth.stamps[after]
    near = np.minimum(np.abs(stamps - before), np.abs(behind - stamps)) <= _NEAR * 1e9
    near |= behind - before <= _SPARSE * 1e9
    return [estimate for estimate, is_near in zip(estimates, near, strict=True) if is_near]


def _beginning(segment: Segment, truth: GroundTruth) -> gtsam.Pose3:
    """Place and yaw of the true world in the segment's, from its first smoothed estimates.

    The estimate is most certain there, and the truth's own noise is averaged.
    """
    first = segment.smoothed[0].stamp
    start = [e for e in segment.smoothed if e.stamp <= first + _BEGINNING * 1e9]
    start = start if len(start) >= _MIN_POSES else segment.smoothed[:_MIN_POSES]
    ours, true = matched(trajectory_of(start), truth)
    if true.quaternions is None:
        raise EvaluationError("ground truth without orientations")
    turn = yaw_alignment(*(Rotation.from_quat(t.quaternions).as_matrix() for t in (ours, true)))
    shift = ours.positions.mean(axis=0) - turn.rotate(true.positions.mean(axis=0))
    return gtsam.Pose3(turn, shift)


def _over_three_sigma(
    in_body: FloatArray, way: FloatArray, estimate: Estimate, sigma: TruthSigma
) -> float:
    of_truth = np.eye(3) * sigma.position**2 + sigma.scale**2 * np.outer(way, way)
    covariance = estimate.covariances[0][3:, 3:] + of_truth
    return float(np.sqrt(in_body @ np.linalg.solve(covariance, in_body)) / 3.0)
