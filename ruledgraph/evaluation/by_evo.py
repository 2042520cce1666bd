# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""ATE and RPE by evo (Michael Grupp), to the digit what its programs evo_ape and evo_rpe print."""

import copy
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.new_folder import new_folder
from ruledgraph.core.trajectory import Trajectory, seconds
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.evaluation.matching import (
    MIN_POSES,
    EvaluationError,
    alignment,
    covered,
    matched,
    yaw_alignment,
)

# evo's classes, which are imported when they are needed.
_Result: TypeAlias = Any
_Trajectory: TypeAlias = Any

Alignment = Literal["none", "origin", "posyaw", "se3", "sim3"]
ALIGNMENTS: tuple[Alignment, ...] = get_args(Alignment)

_TITLES: dict[Alignment, str] = {
    "none": "(not aligned)",
    "origin": "(with origin alignment)",
    "posyaw": "(with alignment of position and yaw)",
    "se3": "(with SE(3) Umeyama alignment)",
    "sim3": "(with Sim(3) Umeyama alignment)",
}
_RELATIONS = {
    "translation": ("translation_part", "m"),
    "rotation": ("rotation_angle_deg", "deg"),
}
DEFAULT_LENGTHS = (1.0, 2.0, 5.0, 10.0)
"""Of RPE, m."""
# RPE of `accuracy` is taken over this length, m.
_RPE_LENGTH = 1.0


@dataclass(frozen=True)
class Errors:
    """evo's statistics of one metric, in `unit`: m or deg."""

    unit: str
    count: int
    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float


@dataclass(frozen=True)
class Association:
    """Which poses were compared: nearest stamps within a tolerance."""

    tolerance: float
    """s."""
    pairs: int
    estimated: int
    """Poses of the estimate."""
    reference: int
    """Poses of the reference."""
    overlap: float
    """Share of the estimate's duration from the first pair to the last."""
    mean_offset: float
    """Mean distance of paired stamps, s."""
    max_offset: float
    path_length: float
    """Of the reference, through its paired poses, m."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare` found."""

    alignment: Alignment
    association: Association
    errors: dict[str, Errors]
    """`ate_translation`, `ate_rotation`, `rpe_translation_1m`, `rpe_rotation_1m`, ..."""
    reference_T_estimate: FloatArray
    """The alignment, (4, 4); its upper left part has the scale in it."""
    notes: tuple[str, ...]
    """What could not be computed."""
    results: dict[str, _Result] = field(repr=False)
    """evo's own, by the names of `errors`."""

    def save(self, folder: Path) -> list[Path]:
        """Write evo's zip files, which `evo_res` reads: one for each of `errors`.

        Raises:
            FolderError: when the folder is not empty or cannot be written.
        """
        from evo.tools import file_interface

        paths = []
        with new_folder(folder):
            for name, result in self.results.items():
                paths.append(folder / f"{name}.zip")
                file_interface.save_res_file(paths[-1], result)
        return paths

    def values(self, name: str) -> FloatArray:
        """The errors of one of `errors`, in its unit, (N,)."""
        return np.asarray(self.results[name].np_arrays["error_array"], dtype=np.float64)

    def times(self, name: str) -> FloatArray:
        """When each of `values` is, s since the first compared pose, (N,)."""
        return np.asarray(self.results[name].np_arrays["seconds_from_start"], dtype=np.float64)

    def aligned_positions(self) -> FloatArray:
        """Of the compared poses, in the reference's frame, m, (N, 3)."""
        _, estimate = self.results["ate_translation"].trajectories.values()
        return np.asarray(estimate.positions_xyz, dtype=np.float64)

    def reference_positions(self) -> FloatArray:
        """Of the reference's compared poses, m, (N, 3)."""
        reference, _ = self.results["ate_translation"].trajectories.values()
        return np.asarray(reference.positions_xyz, dtype=np.float64)


def compare(
    estimate: Trajectory,
    reference: GroundTruth,
    *,
    align: Alignment = "se3",
    tolerance: float = 0.01,
    lengths: Sequence[float] = DEFAULT_LENGTHS,
) -> Comparison:
    """ATE and RPE, each of translation (m) and rotation (degrees).

    Poses are associated as evo does it: nearest stamps within the tolerance, nothing interpolated.
    RPE takes all pairs that are a length of path apart, to 10 % (`evo_rpe --all_pairs`).

    Args:
        estimate: world_T_body.
        reference: ground truth; without orientations there are neither rotations nor RPE.
        align: `none`; `origin`, the first pose; `posyaw`, position and yaw; `se3` and `sim3`, by
            Umeyama's method.
        tolerance: s.
        lengths: of RPE, m.

    Raises:
        EvaluationError: when fewer than three poses pair up, or the alignment needs orientations
            that the reference lacks.
    """
    from evo import EvoException
    from evo.core import metrics, sync
    from evo.main_ape import ape
    from evo.main_rpe import rpe

    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise EvaluationError(f"tolerance {tolerance} s is not positive")
    oriented = reference.quaternions is not None
    if align == "origin" and not oriented:
        raise EvaluationError("the reference has no orientations: choose another alignment")
    ours, theirs = (
        _evo(estimate.stamps, estimate.positions, estimate.quaternions),
        _evo(reference.stamps, reference.positions, reference.quaternions),
    )
    try:
        theirs, ours = sync.associate_trajectories(theirs, ours, max_diff=tolerance)
    except EvoException:
        ours = theirs = None
    if ours is None or ours.num_poses < MIN_POSES:
        raise EvaluationError(
            f"{0 if ours is None else ours.num_poses} poses have a partner within {tolerance} s: "
            f"{covered(estimate, reference)}; widen --tolerance, or compare the same recording"
        )
    association = _association(estimate, reference, ours, theirs, tolerance)
    notes: list[str] = []
    motion = _align(ours, theirs, align, notes)
    results: dict[str, _Result] = {}

    def keep(name: str, result: _Result) -> None:
        result.info["title"] = result.info["title"].replace(_TITLES["none"], _TITLES[align])
        result.add_np_array("alignment_transformation_sim3", motion)
        results[name] = result

    parts = _RELATIONS if oriented else {"translation": _RELATIONS["translation"]}
    for part, (relation, _) in parts.items():
        kind = metrics.PoseRelation[relation]
        keep(f"ate_{part}", ape(copy.deepcopy(theirs), copy.deepcopy(ours), kind))
    if not oriented:
        notes.append("the reference has no orientations: no rotation errors and no RPE")
    for length in lengths if oriented else ():
        if length > 0.5 * association.path_length:
            notes.append(f"no RPE over {length:g} m: the path is {association.path_length:.2f} m")
            continue
        for part, (relation, _) in parts.items():
            pair = copy.deepcopy(theirs), copy.deepcopy(ours)
            try:
                found = rpe(
                    *pair,
                    metrics.PoseRelation[relation],
                    delta=length,
                    delta_unit=metrics.Unit.meters,
                    all_pairs=True,
                )
            except EvoException:
                notes.append(f"no RPE over {length:g} m: no two poses are that far apart")
                break
            keep(f"rpe_{part}_{length:g}m", found)
    errors = {
        name: _errors(result, parts[name.split("_")[1]][1]) for name, result in results.items()
    }
    return Comparison(align, association, errors, motion, tuple(notes), results)


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


def accuracy(estimate: Trajectory, reference: GroundTruth) -> Accuracy:
    """ATE and RPE of an estimate, SE(3)-aligned, by evo.

    Unlike `compare` it interpolates ground truth at the estimate's stamps: exact for ground truth
    that is slower than the camera or out of step with it.

    Raises:
        EvaluationError: when they hardly overlap.
    """
    from evo import EvoException
    from evo.core import metrics

    kept, truth = matched(estimate, reference)
    ours = _evo(kept.stamps, kept.positions, kept.quaternions)
    theirs = _evo(truth.stamps, truth.positions, truth.quaternions)
    _align(ours, theirs, "se3", [])

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
            with suppress(EvoException):  # no two poses that far apart on the estimate's own path
                rpe = statistics(pairs)["rmse"]
    return Accuracy(len(kept), theirs.path_length, ate["rmse"], ate["max"], rotation, rpe)


def _evo(
    stamps: NDArray[np.int64], positions: FloatArray, quaternions: FloatArray | None
) -> _Trajectory:
    """As evo reads it from a TUM file: the same float64 stamps; no orientation is the identity."""
    from evo.core.trajectory import PoseTrajectory3D

    if quaternions is None:
        quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (len(stamps), 1))
    times = np.array([float(seconds(stamp)) for stamp in stamps.tolist()])
    return PoseTrajectory3D(positions.copy(), np.roll(quaternions, 1, axis=1), times)


def _align(
    ours: _Trajectory, theirs: _Trajectory, align: Alignment, notes: list[str]
) -> FloatArray:
    """Move the estimate onto the reference; the motion, (4, 4)."""
    from evo.core.geometry import GeometryException
    from evo.core.lie_algebra import sim3

    if align == "none":
        return np.eye(4)
    if align == "origin":
        return np.asarray(ours.align_origin(theirs))
    if align == "posyaw":
        motion = yaw_alignment(ours.positions_xyz, theirs.positions_xyz)
        ours.transform(motion)
        return motion
    try:
        return np.asarray(sim3(*ours.align(theirs, correct_scale=align == "sim3")))
    except GeometryException:
        if align == "sim3":
            raise EvaluationError(
                "the poses lie on one straight line, which Sim(3) alignment needs to be otherwise; "
                "choose another alignment"
            ) from None
    # Any turn about the line fits as well.
    notes.append("all poses lie on one straight line: the turn about it is arbitrary")
    motion = alignment(ours.positions_xyz, theirs.positions_xyz)
    ours.transform(motion)
    return motion


def _association(
    estimate: Trajectory,
    reference: GroundTruth,
    ours: _Trajectory,
    theirs: _Trajectory,
    tolerance: float,
) -> Association:
    offsets = np.abs(ours.timestamps - theirs.timestamps)
    duration = (estimate.stamps[-1] - estimate.stamps[0]) * 1e-9
    return Association(
        tolerance=tolerance,
        pairs=int(ours.num_poses),
        estimated=len(estimate),
        reference=len(reference.stamps),
        overlap=float((ours.timestamps[-1] - ours.timestamps[0]) / duration),
        mean_offset=float(offsets.mean()),
        max_offset=float(offsets.max()),
        path_length=float(theirs.path_length),
    )


def _errors(result: _Result, unit: str) -> Errors:
    count = len(result.np_arrays["error_array"])
    return Errors(unit, count, **{name: float(value) for name, value in result.stats.items()})
